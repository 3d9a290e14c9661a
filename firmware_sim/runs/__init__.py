"""The results of a run: its series, the figures computed from them, and its report."""
