"""Recording -> latent model, sensor ranking, slim encoder on few sensors, held-out figures and a stored model."""
