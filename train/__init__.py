"""The offline training of a latent model, a sensor ranking and a slim encoder, and their errors on test episodes."""
