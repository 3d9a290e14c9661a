"""One phase of training: the loop over batches, its checkpoints and its progress."""
