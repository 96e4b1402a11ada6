"""Fits made again to the same runs: other readings, draws of the noise, one parameter held at other values."""
