"""`--bus INTERFACE:CHANNEL`: the two settings that a bus is named by, in one option."""

from collections.abc import Sequence
from typing import Annotated, Final

import typer

from contract.errors import ConfigError

BusName = Annotated[
    str | None,
    typer.Option(
        "--bus",
        help="The bus, e.g. socketcan:can0; short for --set bus.interface=... --set bus.channel=...",
        metavar="INTERFACE:CHANNEL",
    ),
]
_NAMES: Final = ("bus.interface", "bus.channel")


def with_bus(bus: str | None, overrides: Sequence[str]) -> list[str]:
    """The overrides with the bus that was named; raises ConfigError for another form, or one in --set too."""
    if bus is None:
        return list(overrides)
    interface, colon, channel = bus.partition(":")
    if not (interface and colon and channel):
        raise ConfigError(f"--bus {bus}: must be INTERFACE:CHANNEL, e.g. socketcan:can0 or udp_multicast:239.74.163.2")
    for name in _NAMES:
        if any(override.partition("=")[0].strip() == name for override in overrides):
            raise ConfigError(f"--bus {bus}: names {name} already; leave out --set {name}")
    return [*overrides, *(f"{name}={value}" for name, value in zip(_NAMES, (interface, channel), strict=True))]
