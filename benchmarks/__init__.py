"""Measurements, and the tables that are made from their results. Run `python -m benchmarks NAME`, then `make
tables`."""
