"""Measurements and the tables made of them: `python benchmarks/NAME.py`, then `make tables`."""
