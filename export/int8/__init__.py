"""Weights as integers: how they are rounded, and what they are calibrated on."""
