"""The additions to python-can's backends, so that no received data can stop a backend."""
