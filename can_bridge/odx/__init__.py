"""The ECU's diagnosis as an ODX description (ISO 22901-1), for diagnostic testers of other makers."""
