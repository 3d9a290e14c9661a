"""The files in `results/`: figures with what they were made from."""

import json
from collections.abc import Mapping
from datetime import date
from importlib.metadata import version
from pathlib import Path
from typing import Any

from contract.atomic import replacing


def write_result(path: Path, *, figures: Any, facts: Mapping[str, Any], on: date) -> None:
    """Write as JSON, whole or not at all.

    Args:
        path: the file.
        figures: what was measured, in the units its reader documents.
        facts: settings, seeds, versions and hashes of the inputs.
        on: the day it was measured.
    """
    content = {"date": on.isoformat(), "figures": figures, "facts": facts}
    with replacing(path) as temporary:
        temporary.write_text(json.dumps(content, indent=2) + "\n", encoding="utf-8")


def versions(*packages: str) -> dict[str, str]:
    """Installed versions, for `facts`."""
    return {package: version(package) for package in packages}
