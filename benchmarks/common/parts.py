"""Finished parts of a long study in files, so that a stopped study can continue."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

from contract.atomic import replacing


def part(path: Path, make: Callable[[], Any]) -> Any:
    """Return the finished part in a file, as plain values for JSON; compute and write it if there is none."""
    if not path.is_file():
        made = make()
        with replacing(path) as temporary:
            temporary.write_text(json.dumps(made), encoding="utf-8")
    return json.loads(path.read_text(encoding="utf-8"))
