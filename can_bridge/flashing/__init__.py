"""Releases into an ECU: the store with its two slots, and the tester that fills it over UDS."""
