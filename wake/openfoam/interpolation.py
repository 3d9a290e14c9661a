"""From the cells of a mesh to other points, repeatedly: the weights are computed once."""

import numpy as np
from scipy.sparse import csr_array
from scipy.spatial import Delaunay, cKDTree

from contract.arrays import Array
from wake.openfoam.mesh import Mesh


class CellInterpolation:
    """Linear between the centres of the cells, on their Delaunay triangles; beyond the outermost the nearest cell's.
    `points` states where they are wanted, (n, 2)."""

    def __init__(self, mesh: Mesh, points: Array) -> None:
        triangles = Delaunay(mesh.centres)
        triangle = triangles.find_simplex(points)
        outside = np.flatnonzero(triangle < 0)
        inside = np.flatnonzero(triangle >= 0)
        # Barycentric coordinates: scipy keeps of each triangle the inverse map to the first two, and its last corner.
        to_share, corner = triangles.transform[triangle[inside], :2], triangles.transform[triangle[inside], 2]
        two = np.einsum("nij,nj->ni", to_share, points[inside] - corner)
        shares = np.column_stack([two, 1.0 - two.sum(axis=1)])
        nearest = cKDTree(mesh.centres).query(points[outside])[1]
        rows = np.concatenate([np.repeat(inside, 3), outside])
        columns = np.concatenate([triangles.simplices[triangle[inside]].ravel(), nearest])
        weights = np.concatenate([shares.ravel(), np.ones(len(outside))])
        self._weights = csr_array((weights, (rows, columns)), shape=(len(points), len(mesh.centres)))

    def __call__(self, values: Array) -> Array:
        """Interpolate values of the cells, (m, ...), to the points, (n, ...)."""
        return np.asarray(self._weights @ values)
