"""The authentication as in AUTOSAR SecOC: a message has a freshness value and a message authentication code (MAC).

E2E protection detects faults; authentication detects attackers. The project has its own profile, in the terms of
AUTOSAR's "Specification of Secure Onboard Communication". Freshness value and authenticator have 64 bits each.
"""
