"""Conversion of the log of a drive to series with one row for each control period."""
