"""The export of a model folder as a release: the program is lowered, the lowerings pass gates, and files are
written."""
