"""Recorded CAN traffic in files: written and read."""
