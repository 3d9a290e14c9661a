"""The runner of campaigns: it executes a test plan of disturbed closed-loop runs in parallel and reports them."""
