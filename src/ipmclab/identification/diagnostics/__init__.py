"""What a fit leaves: whether it is noise, whether it follows the voltage, and which stage would explain it."""
