"""Reading the log of a drive as series on the grid of control periods."""
