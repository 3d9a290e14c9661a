"""A command group a file. One folder below `__main__`, so that no file here shadows a room of the same name."""
