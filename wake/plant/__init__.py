"""The common part of all plants: the protocol, the sample of a control period, the wind."""
