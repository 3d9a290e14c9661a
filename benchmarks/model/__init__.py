"""Measurements of the model, its data and its training."""
