"""The shipped release in the closed loop: measurements, and tables of the results of `stillwake run` and `stillwake
develop --steady`."""
