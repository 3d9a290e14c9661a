"""Incompressible Navier-Stokes on a stretched tensor grid, around any body."""
