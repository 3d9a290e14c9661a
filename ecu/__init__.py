"""The software that a vehicle installs: ECU, fail-safe, window and release runtime, without the package `wake`."""
