"""The import of a user's files as a data set. The files are tables, arrays or OpenFOAM cases."""
