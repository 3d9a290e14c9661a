"""The export of a model folder as a release: lower, gate, write."""
