"""Weights as integers: their rounding and its calibration."""
