"""Recorded episodes: the data set's format, its reader and writer, and how episodes are added."""
