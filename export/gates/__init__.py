"""The checks that a lowering must pass before anything is written."""
