"""Commands that speak to an ECU through diagnosis."""
