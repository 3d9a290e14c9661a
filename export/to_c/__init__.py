"""The program as a C99 library: the arrays and sources in the library's folder."""
