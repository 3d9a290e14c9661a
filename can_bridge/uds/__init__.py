"""The ECU's side of Unified Diagnostic Services (ISO 14229-1): state machines with time and requests as inputs."""
