"""The recorded episodes: the format of a data set, its reader and writer, and how episodes are added."""
