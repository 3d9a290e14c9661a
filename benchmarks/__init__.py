"""Measurements, and the tables made from their results: `python -m benchmarks NAME`, then `make tables`."""
