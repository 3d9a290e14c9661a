"""Measurements and the tables made of them: `python -m benchmarks NAME`, then `make tables`."""
