"""What a lowering must pass before anything is written."""
