"""The scaled rows of a data set, and the batches of windows from these rows."""
