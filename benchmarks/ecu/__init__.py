"""Measurements of the ECU in the closed loop."""
