"""The shipped release in the closed loop: measurements, and tables from `stillwake run` and `develop --steady`."""
