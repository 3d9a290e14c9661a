"""Pictures of the flow, still and moving."""
