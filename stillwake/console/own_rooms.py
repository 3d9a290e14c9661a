"""A check that no file of the user has the name of one of the project's packages. `__main__` imports this module first.

The packages have everyday names, and `python -m stillwake` searches the working folder before the installed packages.
So a user's `train.py` in the working folder would run in place of the package `train`.
"""

import sys
from collections.abc import Sequence
from importlib.util import find_spec
from pathlib import Path
from typing import Final

ROOMS: Final = ("contract", "wake", "train", "export", "can_bridge", "ecu", "firmware_sim", "stillwake")
HOME: Final = Path(__file__).resolve().parents[2]
"""The folder that contains all packages."""


def hidden(rooms: Sequence[str] = ROOMS, home: Path = HOME) -> tuple[str, Path] | None:
    """Return the first of the project's packages that Python finds outside the folder `home`, and where Python finds
    it; None if there is no such package."""
    for room in rooms:
        spec = find_spec(room)
        if spec is None:
            continue
        places = [spec.origin] if spec.origin else list(spec.submodule_search_locations or [])
        files = [Path(place).resolve() for place in places if place]
        if files and not any(path.is_relative_to(home / room) for path in files):
            return room, files[0]
    return None


def explain(room: str, file: Path) -> str:
    """Return one line that tells the user how to remove the conflict between a package and a file."""
    return f"{file} hides the package {room!r} of stillwake: rename it, or call `stillwake` from another folder"


if (other := hidden()) is not None:
    sys.stderr.write(f"error: {explain(*other)}\n")
    sys.exit(1)
