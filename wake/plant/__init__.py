"""What every plant has in common: its protocol, its sample of a control period, the wind."""
