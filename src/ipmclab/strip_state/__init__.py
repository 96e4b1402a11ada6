"""In which state a strip was in a run: its water, its temperature, and what it had been through."""
