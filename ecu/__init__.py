"""The software that a vehicle installs: the ECU, its fail-safe, the controller's window and the release runtime. It
does not need the package `wake`."""
