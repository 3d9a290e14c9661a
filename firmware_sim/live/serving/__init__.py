"""The server of the live page: the loop in its own process, its viewers, and their access."""
