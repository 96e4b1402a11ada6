"""A folder of runs, fits and tables as what a paper or a repository takes."""
