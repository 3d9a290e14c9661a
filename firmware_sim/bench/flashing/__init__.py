"""Flashing in virtual time: a tester beside a vehicle's control traffic on the simulated bus."""
