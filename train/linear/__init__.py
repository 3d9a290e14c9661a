"""Recording -> autoregressive model of mirror differences -> linear-quadratic regulator -> a stored linear model."""
