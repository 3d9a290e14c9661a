"""The folder that is the memory of an ECU on a computer: its store, root key and identity.

    root.pub            public root key
    ecu.json            schema, hardware, serial
    *.record, *.image   files of the store (`can_bridge.flashing.folder_backing`)

A process that may write to the folder can replace all of it, so only root or the service should have this access.
"""

import fcntl
import os
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from shutil import copyfile
from typing import Final

from can_bridge.flashing.checking import Fits
from can_bridge.flashing.folder_backing import FolderBacking, open_regular
from can_bridge.flashing.store import Store
from contract.atomic import replacing
from contract.errors import ConfigError, OutputError
from contract.printable import is_name, quoted
from contract.release import signing, strict_json

_ROOT: Final = "root.pub"
IDENTITY: Final = "ecu.json"
_SCHEMA: Final = "stillwake-ecu/1"
_LOCK: Final = "lock"


@dataclass(frozen=True, kw_only=True)
class EcuFolder:
    """An ECU's folder after its provisioning. `root` is the public key that verifies key lists."""

    folder: Path
    root: signing.PublicKey
    hardware: str
    serial: str


def read_folder(folder: Path, *, root: Path | None = None, hardware: str | None = None) -> EcuFolder:
    """Read an ECU's folder; `root` and `hardware` replace its root key and hardware name. Raises ConfigError if the
    folder is not an ECU's folder; KeyFileError if the root key cannot be read."""
    try:
        raw = (folder / IDENTITY).read_bytes()
    except OSError as error:
        what = f"not a folder of an ECU ({IDENTITY}: {error.strerror})"
        raise ConfigError(f"{folder}: {what}; `stillwake ecu provision` makes such a folder") from error
    try:
        identity = strict_json.decode(raw)
        if identity.keys() != {"schema", "hardware", "serial"} or identity["schema"] != _SCHEMA:
            raise ValueError(f"must have schema {_SCHEMA!r}, hardware and serial")
        found, serial = (_name(identity[name], name) for name in ("hardware", "serial"))
    except (ValueError, ConfigError) as error:
        raise ConfigError(f"{folder / IDENTITY}: {error}; provision a new folder") from error
    key = signing.read_public_key(folder / _ROOT if root is None else root)
    name = found if hardware is None else _name(hardware, "hardware")
    return EcuFolder(folder=folder, root=key, hardware=name, serial=serial)


def provision(
    folder: Path, *, root: Path, keys: bytes, image: bytes | None, hardware: str, serial: str, fits: Fits
) -> EcuFolder:
    """Create the folder of a new ECU, completely or not at all. `root` is the file of the public key that verifies the
    key list. Without an image, the first release must be flashed. Raises OutputError if the folder exists and is not
    empty; ConfigError if the image fails a check, or a name is not allowed; KeyFileError if the root key cannot be
    read or does not verify the list."""
    if os.path.lexists(folder) and not (folder.is_dir() and not any(folder.iterdir())):
        raise OutputError(f"{folder}: exists already; an ECU's memory is never overwritten; name another folder")
    public = signing.read_public_key(root)
    identity = {"schema": _SCHEMA, "hardware": _name(hardware, "hardware"), "serial": _name(serial, "serial")}
    with replacing(folder) as temporary:
        Store(FolderBacking(temporary), root=public, hardware=hardware, fits=fits).provision(keys, image)
        copyfile(root, temporary / _ROOT)
        (temporary / IDENTITY).write_bytes(strict_json.encode(identity))
    return read_folder(folder)


@contextmanager
def held(folder: Path) -> Iterator[None]:
    """Lock the folder against other processes during the block; raise ConfigError if the lock cannot be taken."""
    try:
        handle = open_regular(folder / _LOCK, os.O_WRONLY | os.O_CREAT)
    except OSError as error:
        raise ConfigError(f"{folder / _LOCK}: {error.strerror or error}") from error
    with os.fdopen(handle, "wb") as file:
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError as error:
            raise ConfigError(f"{folder}: another process runs this ECU; end that process first") from error
        yield


def _name(value: object, what: str) -> str:
    if not isinstance(value, str) or not is_name(value):
        raise ConfigError(f"{what} {quoted(value)}: must be a name of printable characters")
    return value
