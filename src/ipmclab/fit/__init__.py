"""What a fit is, and its file."""
