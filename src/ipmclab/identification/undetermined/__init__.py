"""What some readings leave open, each with its cure."""
