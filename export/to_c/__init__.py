"""The program as a C99 library: the arrays and sources of its folder."""
