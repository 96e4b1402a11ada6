"""The mountings of a strip: in what they differ, and what the next one will say."""
