"""The software that a vehicle installs: the ECU, its fail-safe, its window, the release runtime. Imports no wake."""
