"""The ECU's diagnosis as an ODX description (ISO 22901-1), for testers that are not of this project."""
