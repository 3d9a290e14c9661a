"""Measurements of the ECU in its loop."""
