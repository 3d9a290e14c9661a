"""AUTOSAR end-to-end protection: the sender's header and the receiver's state machine."""
