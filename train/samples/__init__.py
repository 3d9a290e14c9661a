"""Rows of a data set, scaled, and the draws from them."""
