"""The plant: a two-dimensional direct numerical simulation of the truck's wake, an environment, and a recorder."""
