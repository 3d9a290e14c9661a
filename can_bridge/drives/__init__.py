"""Conversion of a log of a drive to time series with one row for each control period."""
