"""The shipped release in the closed loop: measurements, and tables of results of `stillwake run` and `develop
--steady`."""
