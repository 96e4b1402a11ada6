"""Several runs and several mountings: what the next one would give, which run disagrees, bands of predictions."""
