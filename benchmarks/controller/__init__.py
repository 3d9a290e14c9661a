"""Measurements of the controller and of its implementations, and tables of their results."""
