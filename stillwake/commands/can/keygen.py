"""`stillwake can keygen`: a key for authenticated frames, or for security access."""

import secrets
from pathlib import Path
from typing import Annotated

import typer

from stillwake.console.terminal import console


def keygen(
    file: Annotated[Path, typer.Argument(help="File to write; one that is there is never overwritten.")],
) -> None:
    """Make a key: for authenticated frames, with `bus.key` on both nodes, or for a tester's access, with --access.

    128 random bits as hexadecimal digits, readable by the file's owner alone. Frames and access need keys of their own.
    """
    from can_bridge.secoc.key import KEY_LENGTH, write_key

    write_key(file, secrets.token_bytes(KEY_LENGTH))
    console.print(f"wrote {file}: keep it secret; for frames it is --set bus.key={file}, for diagnosis --access {file}")
