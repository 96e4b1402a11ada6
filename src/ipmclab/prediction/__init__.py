"""A fitted actuator held against runs, and how sure its answers are."""
