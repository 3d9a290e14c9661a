"""The networks, their loss, and the scaled rows and batches of windows that they learn from."""
