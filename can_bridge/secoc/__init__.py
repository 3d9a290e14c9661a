"""Authenticated frames after AUTOSAR SecOC: a freshness value and a message authentication code behind each message.

E2E protection finds faults; this finds people. The profile is our own, in the terms of AUTOSAR's "Specification of
Secure Onboard Communication": the whole 64-bit freshness value is sent, and 64 bits of the authenticator.
"""
