"""The commands that communicate with an ECU over UDS, the protocol of diagnosis."""
