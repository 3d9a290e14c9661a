"""Flashing in virtual time: a tester next to a vehicle's control traffic on the simulated bus."""
