"""What a strip will do next, with bands: the actuator's slow modes, the drift, a filtered disturbance."""
