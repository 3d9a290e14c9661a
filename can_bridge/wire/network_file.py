"""The messages of a bus, read from a file in a format of cantools (extra `bus`): DBC, ARXML, KCD, SYM."""

import re
from pathlib import Path
from typing import TYPE_CHECKING, Final

from contract.errors import BusError, install
from contract.printable import shown

if TYPE_CHECKING:
    from cantools.database.can.database import Database

LONGEST_MESSAGE: Final = 65_536
"""Largest accepted length of a message, in bytes or, in some formats, in bits. The limit is needed because cantools
allocates memory for every bit. The longest real message has 2048 bytes (CAN XL)."""
_LENGTH: Final = re.compile(rb'(?:^ *BO_ +\d+ +\w+ *: *|\blength="|^ *Len=|LENGTH>)(\d+)', re.MULTILINE)


def load_network(path: Path) -> "Database":
    """Return the description of a bus from a file; the ending of the file's name states the format. Raises BusError,
    with a message of one line, if cantools or the file is missing, or if the file is invalid."""
    try:
        from cantools.database import load_file
        from cantools.database.can.database import Database
    except ModuleNotFoundError as error:
        raise BusError(f"{path}: reading it needs cantools: {install('bus')}") from error
    # Reading a device or a pipe might never end: a device may be endless, and a pipe may have no writer.
    if path.exists() and not path.is_file():
        raise BusError(f"{path}: is a {'directory' if path.is_dir() else 'device or pipe'}, must be a file")
    try:
        for found in _LENGTH.finditer(path.read_bytes()):
            if len(found[1]) > 9 or int(found[1]) > LONGEST_MESSAGE:
                stated = shown(found[0].decode())
                raise ValueError(f"{stated} is the length of a message: must be at most {LONGEST_MESSAGE}")
        # The check is not strict, so that old files with small mistakes can be read.
        database = load_file(path, strict=False)
    except OSError as error:
        raise BusError(f"{path}: {error.strerror or error}") from error
    except Exception as error:
        # cantools and its parsers raise errors of many types.
        reason = " ".join(str(error).split()) or type(error).__name__
        raise BusError(f"{path}: not a description of a CAN bus that cantools can read: {reason}") from error
    if not isinstance(database, Database):
        raise BusError(f"{path}: describes diagnostics, not the messages of a bus")
    return database
