"""Campaigns: a test plan of disturbed closed loops, run in parallel, and what came of it in one report."""
