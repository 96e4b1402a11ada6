"""A fitted actuator compared with runs, and how sure its answers are."""
