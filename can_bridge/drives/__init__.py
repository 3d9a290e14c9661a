"""Conversion of the log of a drive to series on the grid of control periods."""
