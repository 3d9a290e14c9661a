"""The command groups, one file each, one folder below `__main__`, so that no file hides a package of its name."""
