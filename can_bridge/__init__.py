"""The CAN bus: messages as bytes, end-to-end protection, the check of jet commands, and adapters to real and virtual
buses."""
