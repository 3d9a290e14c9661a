"""Measurements of the plant, and their tables."""
