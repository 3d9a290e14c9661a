"""Offline training: a recording gives a latent model, a sensor ranking, a slim encoder and the errors on test
episodes."""
