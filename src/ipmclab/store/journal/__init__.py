"""Runs while they are recorded: the journal, and how it becomes a run file."""
