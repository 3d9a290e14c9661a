"""The definitions and formats that all packages share."""
