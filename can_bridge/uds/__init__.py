"""Unified Diagnostic Services (ISO 14229-1) on the ECU's side, as state machines whose inputs are the time and
requests."""
