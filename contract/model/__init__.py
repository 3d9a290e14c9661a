"""The folders that hold a trained model, which `train` writes and `export` reads."""
