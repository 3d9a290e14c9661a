"""The end-to-end protection of AUTOSAR: the sender's header and the receiver's state machine."""
