"""The page of a run with the data for its script, the comparison of runs, and a run as a measurement file."""
