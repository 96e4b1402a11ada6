"""The noise of each output of each run of a fit, and the fit under it."""
