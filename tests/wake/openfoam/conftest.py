"""One coarse mesh for the folder's tests."""

import pytest

from wake.openfoam.mesh import Mesh, truck_mesh


@pytest.fixture(scope="session")
def coarse_mesh() -> Mesh:
    return truck_mesh(0.5)
