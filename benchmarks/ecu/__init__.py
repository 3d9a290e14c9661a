"""The ECU."""
