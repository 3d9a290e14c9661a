"""The ECU in C held against the Python ECU: the same periods through both, to the bit."""
