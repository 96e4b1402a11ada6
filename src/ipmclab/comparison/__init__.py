"""Runs held side by side: metrics of each, effects of what was varied, frequency responses, the next strip."""
