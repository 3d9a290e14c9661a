"""The results of a run: its series, its figures and its report."""
