"""Additions to python-can's backends that prevent any received data from stopping a backend."""
