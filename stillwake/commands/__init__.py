"""The commands, one file for each group. Python searches the folder of `__main__`; the commands are in a subfolder, so
that none of these files hides a package of the same name."""
