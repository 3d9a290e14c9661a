"""End-to-end protection after AUTOSAR profile 5: the sender's header, and the receiver's state machine."""
