"""`stillwake can keygen`: a key for authenticated frames."""

import secrets
from pathlib import Path
from typing import Annotated

import typer

from stillwake.terminal import console


def keygen(
    file: Annotated[Path, typer.Argument(help="File to write; one that is there is never overwritten.")],
) -> None:
    """Make the key that authenticates frames on the bus: `bus.key` names its file on both nodes.

    128 random bits as hexadecimal digits, readable by the file's owner alone.
    """
    from can_bridge.secoc.key import KEY_LENGTH, write_key

    write_key(file, secrets.token_bytes(KEY_LENGTH))
    console.print(f"wrote {file}: keep it secret, and use it with --set bus.key={file}", soft_wrap=True)
