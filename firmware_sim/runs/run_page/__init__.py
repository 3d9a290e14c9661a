"""A run to be looked through: its data for the script of a page, and several runs beside each other."""
