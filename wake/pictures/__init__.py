"""Pictures and animations of the flow."""
