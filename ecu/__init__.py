"""The software that a vehicle installs: the ECU, its fail-safe, its window and the release runtime. It does not need
the package `wake`."""
