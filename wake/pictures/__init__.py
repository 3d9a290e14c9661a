"""The pictures and animations of the flow."""
