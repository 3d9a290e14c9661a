"""The plant: a two-dimensional direct numerical simulation of the truck's wake with jets on the base; its environment
and its recorder."""
