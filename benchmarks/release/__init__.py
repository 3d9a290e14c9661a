"""Measurements of the shipped release in the closed loop, and tables of their results."""
