"""The common parts of the measurements: commands, tables in Markdown, stored parts, pictures."""
