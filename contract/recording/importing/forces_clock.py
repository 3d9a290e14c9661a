"""What the times of forces next to a log count; apart from their reader, which needs h5py."""

from typing import Literal, TypeAlias

ForcesClock: TypeAlias = Literal["log", "start", "t_c"]
"""Seconds on the log's clock, seconds since the log's first pressure, or W / U_inf since then."""
