"""Scaled rows of a data set, and the batches drawn from them."""
