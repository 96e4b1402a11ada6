"""Runs at many conditions in one fit: the state of the strip in each, its age, and what conditions leave open."""
