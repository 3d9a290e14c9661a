"""The functions that combine several packages and that several commands use."""
