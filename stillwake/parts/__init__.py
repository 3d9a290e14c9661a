"""What several commands put together from the packages."""
