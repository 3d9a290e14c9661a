"""One coarse mesh for the folder's tests."""

import numpy as np
import numpy.typing as npt
import pytest

from wake.openfoam.mesh import Mesh, truck_mesh


@pytest.fixture(scope="session")
def coarse_mesh() -> Mesh:
    return truck_mesh(0.5)


def field(values: npt.ArrayLike) -> bytes:
    """Numbers (m,) or vectors (m, 3) in m cells, as icoFoam writes them."""
    cells = np.asarray(values, dtype=np.float64)
    kind = "scalar" if cells.ndim == 1 else "vector"
    head = 'FoamFile\n{\n    format      binary;\n    arch        "LSB;label=32;scalar=64";\n}\n'
    head += f"internalField   nonuniform List<{kind}> \n{len(cells)}\n("
    return head.encode() + cells.tobytes() + b")\n;\nboundaryField\n{}\n\n\n// " + 73 * b"*" + b" //\n"
