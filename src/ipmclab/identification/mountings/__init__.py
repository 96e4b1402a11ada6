"""The mountings of a strip: what each has for itself, and what the next one will say."""
