"""What every command shares with the terminal: options, progress, output, endings."""
