"""Definitions and formats that all packages share."""
