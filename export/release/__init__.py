"""From a model folder to a release: lower, gate, write."""
