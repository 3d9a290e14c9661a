"""The recorded episodes: the format of data sets, and the functions that read, write, check and import data sets."""
