"""Strips from printed numbers, and printed numbers that no strip can give."""
