"""Functions that import a user's files as a data set: tables, arrays or OpenFOAM cases."""
