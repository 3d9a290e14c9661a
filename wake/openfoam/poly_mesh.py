"""A plane mesh as OpenFOAM's `polyMesh`: one cell thick, the two planes empty."""

from pathlib import Path
from typing import Final

import numpy as np

from wake.openfoam import dictionary
from wake.openfoam.mesh import PATCHES, Mesh

PLANES: Final = "planes"
_KINDS: Final = {"truck": "wall"}


def write(mesh: Mesh, folder: Path) -> None:
    """Write points, faces, owner, neighbour and boundary into `folder`, which must exist."""
    n, m = len(mesh.points), len(mesh.cells)
    points = [f"({x:.17g} {y:.17g} {z})" for z in (0, 1) for x, y in mesh.points]
    sizes = [len(mesh.patches[name]) for name in PATCHES]
    upright = np.vstack([mesh.edges, *(mesh.patches[name] for name in PATCHES)])
    # An edge with its cell on the left becomes a face that looks away from that cell.
    faces = np.vstack(
        [np.column_stack([upright, upright[:, ::-1] + n]), mesh.cells[:, ::-1], mesh.cells + n],
    )
    owner = np.concatenate([mesh.owner, *(mesh.patch_cells[name] for name in PATCHES), np.arange(m), np.arange(m)])
    starts = len(mesh.edges) + np.cumsum([0, *sizes])
    entries = [
        dictionary.block(name, {"type": _KINDS.get(name, "patch"), "nFaces": size, "startFace": start})
        for name, size, start in zip(PATCHES, sizes, starts[:-1], strict=True)
    ]
    entries.append(dictionary.block(PLANES, {"type": "empty", "nFaces": 2 * m, "startFace": starts[-1]}))
    files = {
        "points": ("vectorField", dictionary.numbers(points)),
        "faces": ("faceList", dictionary.numbers([f"4({a} {b} {c} {d})" for a, b, c, d in faces.tolist()])),
        "owner": ("labelList", dictionary.numbers([str(cell) for cell in owner.tolist()])),
        "neighbour": ("labelList", dictionary.numbers([str(cell) for cell in mesh.neighbour.tolist()])),
        "boundary": ("polyBoundaryMesh", "\n".join([str(len(entries)), "(", *entries, ")"])),
    }
    for name, (kind, body) in files.items():
        (folder / name).write_text(dictionary.document(kind, name, body), encoding="ascii")
