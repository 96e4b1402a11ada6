"""The state space of noise: what noise a reading may have, how it is filtered, and which one readings show."""
