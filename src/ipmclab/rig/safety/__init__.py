"""What keeps the strip safe: limits, the guard, the layer that hands voltages on, the guardian."""
