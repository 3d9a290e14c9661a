"""The authentication of messages by a freshness value and a message authentication code (MAC), as in AUTOSAR SecOC.

E2E protection detects faults; authentication detects attackers. The project has a profile of its own, described in the
terms of AUTOSAR's "Specification of Secure Onboard Communication". Freshness value and authenticator have 64 bits each.
"""
