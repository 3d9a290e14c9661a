"""The conversion of a drive's log to time series with one row for each control period."""
