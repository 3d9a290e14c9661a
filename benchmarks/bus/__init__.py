"""Measurements of the bus: codec, protection, response times, reception under attack, and command gate."""
