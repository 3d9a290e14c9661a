"""The parts that all plants share: the protocol, the sample of a control period, and the wind."""
