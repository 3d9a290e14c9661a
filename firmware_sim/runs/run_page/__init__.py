"""The page of a run: its data for the page's script, and several runs next to each other."""
