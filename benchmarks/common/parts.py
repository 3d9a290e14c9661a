"""Finished parts of a long study, stored in files, so that an interrupted study can continue."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

from contract.atomic import replacing


def part(path: Path, make: Callable[[], Any]) -> Any:
    """Return the finished part in a file, as plain values for JSON; if the file does not exist, compute the part and
    write the file."""
    if not path.is_file():
        made = make()
        with replacing(path) as temporary:
            temporary.write_text(json.dumps(made), encoding="utf-8")
    return json.loads(path.read_text(encoding="utf-8"))
