"""The optimiser's settings of a release tuned in the closed loop: which settings, how a run is scored, the search."""
