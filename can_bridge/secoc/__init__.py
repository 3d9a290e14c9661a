"""The authentication of messages by freshness value and MAC, as in AUTOSAR SecOC (docs/explanation/protection.md)."""
