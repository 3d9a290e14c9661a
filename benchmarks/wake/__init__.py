"""Measurements of the plant, and tables of their results."""
