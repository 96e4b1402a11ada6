"""Where a search starts, how it goes down, and what else it may find."""
