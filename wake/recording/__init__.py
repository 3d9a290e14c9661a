"""Recording data sets: what the jets do, episodes block by block, side by side, under a controller."""
