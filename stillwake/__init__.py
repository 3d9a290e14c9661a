"""The package of the command line, which is the only package that may import all other packages."""
