"""Measured numbers with what makes them uncertain, and the stiffness from a push."""
