"""The folder of a trained model, which `train` writes and `export` reads."""
