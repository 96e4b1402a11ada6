"""The noise of one output of one run: offset, trend, autoregression, random walk; exact restricted likelihood."""
