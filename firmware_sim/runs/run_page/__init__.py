"""The page of a run, with the data for its script, and the comparison of several runs on one page."""
