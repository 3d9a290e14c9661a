"""The functions for the files in `results/`, which contain figures and facts about the origin of the figures."""

import json
import os
import platform
import re
from collections.abc import Mapping
from datetime import date
from functools import cache
from importlib.metadata import version
from pathlib import Path
from typing import Any

from contract.atomic import replacing

_version = cache(version)  # parsing the metadata takes milliseconds


def write_result(path: Path, *, figures: Any, facts: Mapping[str, Any], on: date) -> None:
    """Write measured figures as JSON, completely or not at all, with facts about their origin: settings, seeds,
    versions and hashes of the inputs. This function adds a description of the machine."""
    content = {"date": on.isoformat(), "figures": figures, "facts": {**facts, "machine": machine()}}
    with replacing(path) as temporary:
        temporary.write_text(json.dumps(content, indent=2) + "\n", encoding="utf-8")


def is_result(path: Path) -> bool:
    """Return whether a file begins as the files of `write_result` do; the file may be large, or no text."""
    with path.open("rb") as file:
        return re.match(rb'\s*\{\s*"date":', file.read(80)) is not None


def versions(*packages: str) -> dict[str, str]:
    """Return the installed versions of packages, as part of the `facts` of a result."""
    return {package: _version(package) for package in packages}


def machine() -> str:
    """Return this computer's processor and its number of logical cores, as part of the `facts` of a result."""
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    except OSError:
        lines = []
    named = (line.partition(":")[2].strip() for line in lines if line.startswith("model name"))
    return f"{next(named, platform.processor() or platform.machine())}, {os.cpu_count()} cores"
