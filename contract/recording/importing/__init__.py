"""The way to a data set from a user's files: tables, arrays or cases of OpenFOAM."""
