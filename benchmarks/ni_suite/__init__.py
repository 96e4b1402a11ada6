"""NI's published examples and tests on the stand-in: what dresses it up for them, and what judges their ends."""
