"""From runs to a fitted actuator."""
