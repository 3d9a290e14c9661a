"""Campaigns: test plans of disturbed closed-loop runs, which run in parallel, and one report of their results."""
