"""The loop that runs under a live session: what it does in a period, what is switched on in it, what it keeps."""
