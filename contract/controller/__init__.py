"""The interface of a released controller, and the files of its C library."""
