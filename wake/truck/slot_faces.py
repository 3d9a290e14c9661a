"""The flow's load on the two slot faces, from the momentum balance of the half cell before each face.

Near a slot the pressure falls by several dynamic pressures within a slot's width, and a straight line through two
cells misses a fifth of it. Momentum does not: along x, p + u^2 - 2 nu du/dx is the same on the face and half a cell
before it, but for what leaves through the half cell's sides and for its own acceleration, which are small and nearly
cancel over a cycle. On the default grid this gives the force on slots resolved twice as finely within 2 %.
"""

from dataclasses import dataclass

import numpy as np

from contract.arrays import Array
from wake.solver.flow import Flow
from wake.solver.grid import Grid


@dataclass(frozen=True, kw_only=True, eq=False)
class SlotLoad:
    """Force on both slot faces per unit of rho U_inf^2 W / 2, and mean Cp over each, weighted with its profile."""

    Cd_pressure: float
    Cd_viscous: float
    Cp_upper: float
    Cp_lower: float


class SlotFaces:
    """The slots of one grid.

    Args:
        viscosity: 1 / Re.
        profile: velocity on the faces at `grid.rear` per unit action, (ny,).
    """

    def __init__(self, grid: Grid, viscosity: float, profile: Array) -> None:
        self._rear = grid.rear
        self._upper = slice(grid.upper - grid.slot_cells, grid.upper)
        self._lower = slice(grid.lower, grid.lower + grid.slot_cells)
        self._dy = grid.dy
        self._stress = 4.0 * viscosity / float(grid.dx[grid.rear])
        # Both profiles have flow rate 1, so these weights sum to one over each slot.
        self._weight = np.abs(profile) * grid.dy

    def measure(self, flow: Flow) -> SlotLoad:
        """The load at one instant."""
        face, ahead, between = self._faces(flow)
        Cp = 2.0 * (flow.cells_p[self._rear] + between * between - face * face)
        slots = (self._upper, self._lower)
        return SlotLoad(
            Cd_pressure=-sum(float(Cp[rows] @ self._dy[rows]) for rows in slots),
            Cd_viscous=self._stress * sum(float((ahead - face)[rows] @ self._dy[rows]) for rows in slots),
            Cp_upper=float(Cp[self._upper] @ self._weight[self._upper]),
            Cp_lower=float(Cp[self._lower] @ self._weight[self._lower]),
        )

    def weigh(self, bar: Flow, flow: Flow, weights: SlotLoad) -> None:
        """Add to `bar` the sensitivities to the flow of the load's sum with these weights."""
        face, _, between = self._faces(flow)
        Cp = np.zeros_like(face)
        for rows in (self._upper, self._lower):
            Cp[rows] -= weights.Cd_pressure * self._dy[rows]
        Cp[self._upper] += weights.Cp_upper * self._weight[self._upper]
        Cp[self._lower] += weights.Cp_lower * self._weight[self._lower]
        shear = np.zeros_like(face)
        for rows in (self._upper, self._lower):
            shear[rows] = weights.Cd_viscous * self._stress * self._dy[rows]
        bar.cells_p[self._rear] += 2.0 * Cp
        bar.faces_u[self._rear] += 2.0 * Cp * (between - 2.0 * face) - shear
        bar.faces_u[self._rear + 1] += 2.0 * Cp * between + shear

    def _faces(self, flow: Flow) -> tuple[Array, Array, Array]:
        """u on the base's faces, one cell behind, and between."""
        face, ahead = flow.faces_u[self._rear], flow.faces_u[self._rear + 1]
        return face, ahead, 0.5 * (face + ahead)
