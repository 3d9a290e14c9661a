"""The commands that communicate with an ECU through diagnosis."""
