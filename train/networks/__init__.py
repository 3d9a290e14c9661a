"""The networks and their loss."""
