"""Offline training: from a recording to a stored latent model with a sensor ranking, a slim encoder on few sensors, and
test figures."""
