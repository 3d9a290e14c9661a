"""Measurements (`python -m benchmarks NAME`), and the tables that are made from their results (`make tables`)."""
