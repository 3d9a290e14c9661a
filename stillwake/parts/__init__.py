"""Parts of several commands that combine the packages."""
