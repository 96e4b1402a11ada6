"""The recorder as a process of its own, and how its clients speak with it."""
