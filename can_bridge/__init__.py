"""The CAN bus: messages, end-to-end protection, the check of jet commands, and adapters to real and virtual buses."""
