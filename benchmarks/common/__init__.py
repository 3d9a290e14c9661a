"""The code that the measurements share: commands, tables in Markdown, stored results, pictures."""
