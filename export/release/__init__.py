"""The way from a model folder to a release: lower, gate, write."""
