"""Measurements of the controller and of its implementations, and their tables."""
