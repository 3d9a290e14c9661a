"""The controller program: weights, scaling and MPC settings, taken from a trained model."""
