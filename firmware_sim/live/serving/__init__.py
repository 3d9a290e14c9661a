"""The server of the live page: the loop in a process of its own, its viewers, who may ask it."""
