"""The training loop of one phase, its checkpoints and its progress reports."""
