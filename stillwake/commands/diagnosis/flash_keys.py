"""`stillwake flash-keys`: which keys may sign releases, into an ECU."""

from pathlib import Path
from typing import Annotated, Final

import typer

from contract.errors import KeyFileError
from stillwake.console.bus_option import BusName, with_bus
from stillwake.console.settings import TESTERS_BUS, settings
from stillwake.console.terminal import ConfigFile, Overrides, console
from stillwake.parts.conversation import asking

MAX_BYTES: Final = 4092
"""Longest list: what one UDS request carries with service and identifier."""


def flash_keys(
    keys: Annotated[Path, typer.Argument(help="Key list, as `bundle keylist` makes it.")],
    access: Annotated[
        Path, typer.Option(help="The ECU's access key, a file as `can keygen` writes it.", metavar="KEYFILE")
    ],
    bus: BusName = None,
    config_file: ConfigFile = None,
    overrides: Overrides = [],  # noqa: B006
) -> None:
    """Bring a list of the keys that may sign releases into an ECU over UDS.

    The ECU takes a list that its root key signed, that is newer than the one it has, and that keeps the key of the
    confirmed release. The jets must be shut and the vehicle must not ask for control.

    Exit status: 3 no answer from the ECU; 4 the access key is wrong; 5 not now, the vehicle is in use; 6 the
    ECU does not take this list; 7 the ECU refused something else.

    stillwake flash-keys new.keys --bus socketcan:can0 --access access.key
    """
    from can_bridge.tester.key_list import bring

    config = settings("flash-keys", config_file, with_bus(bus, overrides), uses=TESTERS_BUS).config
    raw = _read(keys)
    with asking(config.bus, access) as ecu:
        before, after = bring(ecu, raw)
    console.print(f"the ECU has key list {after}, and had {before or 'none'}")


def _read(path: Path) -> bytes:
    try:
        with path.open("rb") as file:
            raw = file.read(MAX_BYTES + 1)
    except OSError as error:
        raise KeyFileError(f"key list {path}: {error.strerror or error}") from error
    if not 0 < len(raw) <= MAX_BYTES:
        raise KeyFileError(f"key list {path}: must have 1 to {MAX_BYTES} bytes")
    return raw
