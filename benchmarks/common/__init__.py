"""What every measurement shares: commands, tables in Markdown, the data."""
