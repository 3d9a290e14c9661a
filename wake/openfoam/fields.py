"""Fields as icoFoam writes them."""

import re
from pathlib import Path
from typing import Final

import numpy as np

from contract.arrays import Array
from contract.errors import PlantError

_WIDTH: Final = {b"scalar": 1, b"vector": 3}
_LIST: Final = re.compile(rb"internalField\s+nonuniform\s+List<(scalar|vector)>\s*(\d+)\s*\(")
_TIME: Final = re.compile(r"\d+(\.\d+)?(e[+-]\d+)?")


def parse_cells(content: bytes, name: str) -> Array:
    """A field's values in the cells, (m,) or (m, 3), from a file written in binary with 64-bit numbers. Raises
    PlantError if it is of another kind or cut short; the message has `name`."""
    listing = _LIST.search(content)
    if listing is None or b"scalar=64" not in content[: listing.start()]:
        raise PlantError(f"{name}: must hold a binary list of 64-bit numbers, one a cell")
    width, count = _WIDTH[listing[1]], int(listing[2])
    size = 8 * width * count
    values = content[listing.end() : listing.end() + size]
    if len(values) < size:
        raise PlantError(f"{name}: holds {len(values)} of {size} bytes of its field")
    flat = np.frombuffer(values, dtype="<f8").astype(np.float64)
    return flat if width == 1 else flat.reshape(count, width)


def latest(folder: Path) -> Path | None:
    """The folder of the latest time after 0 whose fields are there, or None."""
    times = [
        (float(item.name), item) for item in folder.iterdir() if _TIME.fullmatch(item.name) and (item / "p").is_file()
    ]
    later = [item for item in times if item[0] > 0]
    return max(later)[1] if later else None
