"""The plant: a two-dimensional direct numerical simulation of the truck's wake, with its Gymnasium environment and the
recorder of data sets."""
