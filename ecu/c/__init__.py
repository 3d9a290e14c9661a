"""The C sources of the ECU, its loader, a board and the FMUs."""
