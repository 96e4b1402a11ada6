"""The state space of noise: what noise a reading may have, and how it is filtered."""
