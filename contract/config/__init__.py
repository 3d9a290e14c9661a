"""Every setting as one tree of frozen dataclasses, and how it is read."""
