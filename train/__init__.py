"""Offline training: from a recording to a latent model, a sensor ranking, a slim encoder and test errors."""
