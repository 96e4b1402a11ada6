"""Runs as files of other programs. Each format writes a run whole, and reads its own export back."""
