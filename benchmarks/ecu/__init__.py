"""Measurements of the ECU on a hostile bus."""
