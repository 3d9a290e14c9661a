"""The plant: a two-dimensional direct numerical simulation of the truck's wake; its environment and its recorder."""
