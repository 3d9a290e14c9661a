"""The offline training of the networks, the choice of the sensors, and the networks' errors on test episodes."""
