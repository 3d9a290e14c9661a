"""Measurements of the bus."""
