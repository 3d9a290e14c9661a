"""Finished parts of a long study on disk, so that a stopped one continues."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

from contract.atomic import replacing


def part(path: Path, make: Callable[[], Any]) -> Any:
    """The finished part in that file, made now if it is not there: plain values for JSON."""
    if not path.is_file():
        made = make()
        with replacing(path) as temporary:
            temporary.write_text(json.dumps(made), encoding="utf-8")
    return json.loads(path.read_text(encoding="utf-8"))
