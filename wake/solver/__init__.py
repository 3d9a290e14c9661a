"""Incompressible Navier-Stokes on a stretched tensor grid; knows no truck."""
