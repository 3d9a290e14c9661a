"""From files of one's own, tables, arrays or cases of OpenFOAM, to a data set."""
