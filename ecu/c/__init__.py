"""The ECU in C: its sources, those of its loader, of a board and of FMUs."""
