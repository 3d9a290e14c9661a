"""The parts of the command line that all commands share: options, progress, output, exit status."""
