"""The C library of a release on this machine: its compilation, its controller, its ECU."""
