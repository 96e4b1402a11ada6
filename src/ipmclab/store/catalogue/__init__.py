"""The catalogue of runs: questions, kept true by sweeps, rebuilt from the files."""
