"""The software that a vehicle installs: the ECU, its fail-safe, its window and the release runtime. It imports no
wake."""
