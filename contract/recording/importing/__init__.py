"""From files of one's own, CSV, NPZ or HDF5, to a data set."""
