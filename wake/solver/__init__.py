"""A solver of the incompressible Navier-Stokes equations on a stretched tensor grid, around any body."""
