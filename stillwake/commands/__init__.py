"""The command groups, one file each, one folder below `__main__`, so that no file here hides a package of the same
name."""
