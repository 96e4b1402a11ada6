"""The thesis's own procedure: small experiments in a row, each with its uncertainty (Friend, figure 4.9)."""
