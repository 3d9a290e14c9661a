"""The C sources of the ECU, of its loader, of a board and of the FMUs."""
