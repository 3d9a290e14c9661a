"""The finished parts of a long study, stored in files, so that an interrupted study can be continued."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

from contract.atomic import replacing


def part(path: Path, make: Callable[[], Any]) -> Any:
    """Return the finished part stored in a file, as plain values for JSON. If the file does not exist, compute the part
    and write it to the file."""
    if not path.is_file():
        made = make()
        with replacing(path) as temporary:
            temporary.write_text(json.dumps(made), encoding="utf-8")
    return json.loads(path.read_text(encoding="utf-8"))
