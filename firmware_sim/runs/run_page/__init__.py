"""The page of a run and the data for its script, the page that compares runs, and a run as a measurement file."""
