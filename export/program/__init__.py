"""The controller program: weights, scaling and MPC settings as arrays, and their sources."""
