"""The C library of a release on this machine: compiler, controller, ECU."""
