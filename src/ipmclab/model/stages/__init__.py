"""The stages of an actuator: each its parameters and, for a parameter vector, a linear block."""
