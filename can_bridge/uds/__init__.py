"""Unified Diagnostic Services (ISO 14229-1) on the ECU's side: state machines with time and requests as inputs."""
