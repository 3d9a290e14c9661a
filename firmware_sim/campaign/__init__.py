"""Campaigns, which run a test plan of disturbed closed-loop runs in parallel and report their results together."""
