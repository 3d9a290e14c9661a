"""Options that several commands for the bus share, and how their numbers are looked at."""

from math import isfinite
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Final

import typer

from contract.errors import ConfigError

if TYPE_CHECKING:
    from can_bridge.secoc.key import Key

BUS: Final = ("bus.interface", "bus.channel", "bus.nominal_bitrate", "bus.data_bitrate")
"""Settings that reach a bus."""

Duration = Annotated[float | None, typer.Option("--for", help="End after so many seconds.", metavar="SECONDS")]

Channel = Annotated[
    str | None, typer.Option(help="Channel of the log, by its name there.", metavar="NAME", show_default=False)
]

_LONGEST_S: Final = 1e7
"""Four months: any longer is a slip, and clocks count it without rounding."""

UNCHECKED: Final = "MAC not checked: name the key with --set bus.key=FILE"
"""Said of secured messages that only their end-to-end checks were looked at."""


def key_of(file: str) -> "Key | None":
    """The key in the file that `bus.key` names; None without one. Raises KeyFileError, see `read_key`."""
    from can_bridge.secoc.key import read_key

    return read_key(Path(file)) if file else None


def positive(option: str, value: float) -> float:
    """The number itself; raises ConfigError by the option's name if it is not in 0..1e7, both ends left out."""
    if not (isfinite(value) and 0.0 < value <= _LONGEST_S):
        raise ConfigError(f"{option} {value:g}: must be a number above 0, up to {_LONGEST_S:g}")
    return value
