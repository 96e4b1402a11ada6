"""Measured numbers with what makes them uncertain, several of them taken together, and the stiffness from a push."""
