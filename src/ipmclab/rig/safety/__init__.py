"""What keeps the strip safe: limits, the guard, the layer that passes voltages on, the guardian."""
