"""The additions to python-can's backends that keep invalid received data from stopping a backend."""
