"""The plant: a two-dimensional direct numerical simulation of the truck's wake, a Gymnasium environment of this
simulation, and a recorder of data sets."""
