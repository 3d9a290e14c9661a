"""Options that several commands for the bus share, and the checks of their numbers."""

from math import isfinite
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Final

import typer

from contract.errors import ConfigError

if TYPE_CHECKING:
    from can_bridge.secoc.key import Key

BUS: Final = ("bus.interface", "bus.channel", "bus.nominal_bitrate", "bus.data_bitrate")
"""Settings for the connection to a bus."""

Duration = Annotated[float | None, typer.Option("--for", help="End after this number of seconds.", metavar="SECONDS")]

Channel = Annotated[
    str | None, typer.Option(help="Channel of the log, by its name there.", metavar="NAME", show_default=False)
]

_LONGEST_S: Final = 1e7
"""Longest time in s that an option accepts: four months. A longer time is a mistake, and clocks may round it."""

UNCHECKED: Final = "MAC not checked: name the key with --set bus.key=FILE"
"""Note for the user that secured messages got only the end-to-end check, because no key was given."""


def key_of(file: str) -> "Key | None":
    """Return the key in the file named by `bus.key`; None without a file. Raises KeyFileError as `read_key` does."""
    from can_bridge.secoc.key import read_key

    return read_key(Path(file)) if file else None


def positive(option: str, value: float) -> float:
    """Return the number; raises ConfigError with the option's name unless it is above 0 and at most 1e7."""
    if not (isfinite(value) and 0.0 < value <= _LONGEST_S):
        raise ConfigError(f"{option} {value:g}: must be a number above 0, up to {_LONGEST_S:g}")
    return value
