"""A campaign: samples, signals, environments and repeats, planned, recorded and reported."""
