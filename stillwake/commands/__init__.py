"""The command groups, a file for each. They are one folder below `__main__`, so that no file here hides a package of
the same name."""
