"""What a run leaves behind: its series, its figures and its report."""
