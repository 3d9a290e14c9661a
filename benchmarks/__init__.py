"""Measurements and the tables made from them: `python -m benchmarks NAME`, then `make tables`."""
