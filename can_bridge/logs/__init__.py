"""Files of recorded CAN traffic: writing and reading."""
