"""The program as a C99 library: arrays and sources that a folder is made of."""
