"""What could be identified at all, and what some readings leave open, each with its cure."""
