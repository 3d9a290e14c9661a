"""The plant: two-dimensional DNS of the truck's wake with jets on the base, its environment and its recorder."""
