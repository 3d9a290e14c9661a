"""Roads to less drag: every controller that was tried, a module each, in one table."""
