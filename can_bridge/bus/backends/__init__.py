"""The extensions of python-can's backends, with which invalid received data do not stop a backend."""
