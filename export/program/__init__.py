"""The controller program: weights, scaling and MPC settings as arrays, and where they come from."""
