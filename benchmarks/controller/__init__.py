"""Measurements of the controller and its lowerings, and their tables."""
