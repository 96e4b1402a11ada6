"""Where a fit starts: found from the data, never from the values of the free parameters."""
