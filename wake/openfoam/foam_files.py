"""A writer and a reader of OpenFOAM's files: dictionaries, lists, a plane mesh as `polyMesh`, and icoFoam's fields."""

import re
import shutil
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Final

import numpy as np

from contract.arrays import Array
from contract.errors import PlantError
from wake.openfoam.mesh import PATCHES, Mesh


def document(kind: str, name: str, body: str) -> str:
    """Return the text of a file of OpenFOAM class `kind`."""
    header = block("FoamFile", {"version": "2.0", "format": "ascii", "class": kind, "object": name})
    return f"{header}\n{body}\n"


def dictionary(name: str, entries: Mapping[str, Any]) -> str:
    return document("dictionary", name, _entries(entries, ""))


def block(name: str, entries: Mapping[str, Any], indent: str = "") -> str:
    """Return the text of a named sub-dictionary."""
    return f"{indent}{name}\n{indent}{{\n{_entries(entries, indent + '    ')}{indent}}}\n"


def vectors(xy: Array) -> str:
    """Return the text of a list of n vectors with the given x and y, (n, 2), and z = 0."""
    return numbers([f"({x:.17g} {y:.17g} 0)" for x, y in xy])


def numbers(items: Sequence[str]) -> str:
    """Return the text of a list: its length, then its items."""
    return "\n".join([str(len(items)), "(", *items, ")"])


def _entries(entries: Mapping[str, Any], indent: str) -> str:
    return "".join(
        block(key, value, indent) if isinstance(value, Mapping) else f"{indent}{key} {_value(value)};\n"
        for key, value in entries.items()
    )


def _value(value: Any) -> str:
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, float):
        return repr(float(value))  # `repr` of a NumPy number would also contain the name of its type
    if isinstance(value, tuple | list):
        return f"({' '.join(_value(item) for item in value)})"
    return str(value)


PLANES: Final = "planes"


def write_poly_mesh(mesh: Mesh, folder: Path) -> None:
    """Write points, faces, owner, neighbour and boundary into `folder`, which must exist."""
    n, m = len(mesh.points), len(mesh.cells)
    points = [f"({x:.17g} {y:.17g} {z})" for z in (0, 1) for x, y in mesh.points]
    sizes = [len(mesh.patches[name]) for name in PATCHES]
    upright = np.vstack([mesh.edges, *(mesh.patches[name] for name in PATCHES)])
    # An edge with its cell on the left becomes a face whose normal points away from this cell.
    faces = np.vstack([np.column_stack([upright, upright[:, ::-1] + n]), mesh.cells[:, ::-1], mesh.cells + n])
    owner = np.concatenate([mesh.owner, *(mesh.patch_cells[name] for name in PATCHES), np.arange(m), np.arange(m)])
    starts = len(mesh.edges) + np.cumsum([0, *sizes])
    entries = [
        block(name, {"type": "wall" if name == "truck" else "patch", "nFaces": size, "startFace": start})
        for name, size, start in zip(PATCHES, sizes, starts[:-1], strict=True)
    ]
    entries.append(block(PLANES, {"type": "empty", "nFaces": 2 * m, "startFace": starts[-1]}))
    files = {
        "points": ("vectorField", numbers(points)),
        "faces": ("faceList", numbers([f"4({a} {b} {c} {d})" for a, b, c, d in faces.tolist()])),
        "owner": ("labelList", numbers([str(cell) for cell in owner.tolist()])),
        "neighbour": ("labelList", numbers([str(cell) for cell in mesh.neighbour.tolist()])),
        "boundary": ("polyBoundaryMesh", "\n".join([str(len(entries)), "(", *entries, ")"])),
    }
    for name, (kind, body) in files.items():
        (folder / name).write_text(document(kind, name, body), encoding="ascii")


_WIDTH: Final = {b"scalar": 1, b"vector": 3}
_LIST: Final = re.compile(rb"internalField\s+nonuniform\s+List<(scalar|vector)>\s*(\d+)\s*\(")
_TIME: Final = re.compile(r"\d+(\.\d+)?(e[+-]\d+)?")


def parse_cells(content: bytes, name: str) -> Array:
    """Read a field's values in the m cells, (m,) or (m, 3), from a file written in binary with 64-bit numbers. Raises
    PlantError if the file has another format or is truncated; the message contains `name`."""
    listing = _LIST.search(content)
    if listing is None or b"scalar=64" not in content[: listing.start()]:
        raise PlantError(f"{name}: must hold a binary list of 64-bit numbers, one per cell")
    width, count = _WIDTH[listing[1]], int(listing[2])
    size = 8 * width * count
    values = content[listing.end() : listing.end() + size]
    if len(values) < size:
        raise PlantError(f"{name} is truncated: it has {len(values)} of the field's {size} bytes")
    flat = np.frombuffer(values, dtype="<f8").astype(np.float64)
    return flat if width == 1 else flat.reshape(count, width)


_VALUES: Final = re.compile(
    rb"nonuniform\s+List<(?P<type>scalar|vector)>\s*(?P<count>\d+)\s*\("
    rb"|(?<![a-z])uniform\s+(?P<uniform>\([^()]*\)|[^\s();]+)"
)


def scaled(content: bytes, factor: float) -> bytes:
    """Multiply all values of a field by `factor`, in cells and on patches, in its binary file of 64-bit numbers."""
    parts, done = list[bytes](), 0
    while found := _VALUES.search(content, done):
        if found["type"]:
            parts.append(content[done : found.end()])
            done = found.end() + 8 * _WIDTH[found["type"]] * int(found["count"])
            parts.append((factor * np.frombuffer(content[found.end() : done], dtype="<f8")).tobytes())
        else:
            text = found["uniform"].decode("ascii")
            values = " ".join(f"{factor * float(number):.17g}" for number in text.strip("()").split())
            parts += [content[done : found.start("uniform")], (f"({values})" if "(" in text else values).encode()]
            done = found.end()
    return b"".join([*parts, content[done:]])


FIELDS: Final = ("U", "p", "phi", "U_0", "phi_0")
"""The files of velocity, pressure and the flux through every face; U_0 and phi_0 are U and phi of the step before."""
_END: Final = re.compile(rb"\n// \*{60,} //\s*$")
"""The divider at the end of every file that icoFoam has written completely."""


def latest(folder: Path) -> Path | None:
    """Return the folder of the latest time after 0 whose `FIELDS` are complete; None if there is no such time."""
    complete = [time for time in _times_after_0(folder) if _is_complete(time)]
    return max(complete, key=lambda time: float(time.name), default=None)


def remove_incomplete(folder: Path) -> None:
    """Remove the folders of times after 0 with incomplete `FIELDS`. A killed icoFoam leaves such a folder, and would
    continue from it."""
    for time in _times_after_0(folder):
        if not _is_complete(time):
            shutil.rmtree(time)


def _times_after_0(folder: Path) -> list[Path]:
    return [item for item in folder.iterdir() if _TIME.fullmatch(item.name) and float(item.name) > 0]


def _is_complete(time: Path) -> bool:
    files = [time / name for name in FIELDS]
    return all(file.is_file() and _END.search(file.read_bytes()[-200:]) for file in files)
