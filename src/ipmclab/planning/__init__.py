"""Which runs to record next: what each would tell of a fitted strip, for the time that it takes on the bench."""
