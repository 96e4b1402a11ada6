"""Samples of what the readings and what was known beforehand leave of the parameters of a fit."""
