"""The outline of the body, its jets, and the sensors and forces as functionals of the flow. Forces are in units of rho
U_inf^2 W / 2.

The body is a rectangle whose front corners may be rounded (paper, figure 1). Two slots at the edges of its base act in
opposition: one blows while the other sucks. Each measured quantity except the slots' load is a fixed weighted sum of u,
v and p, so one sparse product per control step gives these quantities. The wall pressure follows from a parabola along
the normal. The parabola passes through two points in the flow; its slope at the wall follows from the momentum balance
of fluid at rest. At the rounded corners, a straight line would give 1 % too little drag.

The load on the two slot faces comes from the momentum balance of the half cell downstream of each face. The sum
`p + u^2 - 2 nu du/dx` on the face equals its value half a cell downstream. The flux through the half cell's sides and
the acceleration in it are neglected; they are small and nearly cancel over a cycle. On the default grid the result is
within 2 % of the force on a grid with half the cell size; a straight line through two cells gives an error of 20 %.
"""

from collections import defaultdict
from typing import Final

import numpy as np
import numpy.typing as npt
from scipy.sparse import csr_array

from contract.arrays import Array
from contract.config.body import TRUCK_BODY, BodyConfig
from contract.geometry import HALF_WIDTH, JET_WIDTH
from contract.sensor_layout import SensorLayout
from wake.plant.sample import Sample
from wake.solver.boundary import Boundary
from wake.solver.grid import Component, Flow, Grid, bilinear


def signed_distance(x: npt.ArrayLike, y: npt.ArrayLike, body: BodyConfig = TRUCK_BODY) -> Array:
    """Return the distance to the outline in W, positive in the fluid; exact outside, and inside near the outline."""
    x, y = np.asarray(x, dtype=np.float64), np.abs(np.asarray(y, dtype=np.float64))
    # One box has only sharp corners. The other has only rounded corners, with the radius of the body's front.
    sharp = _box_distance(x, y, body.length, 0.0)
    rounded = _box_distance(x, y, body.length, body.leading_edge_radius)
    return np.where(x < 0.5 * body.length, rounded, sharp)


def _box_distance(x: Array, y: Array, length: float, radius: float) -> Array:
    qx = np.abs(x - 0.5 * length) - (0.5 * length - radius)
    qy = y - (HALF_WIDTH - radius)
    outside = np.hypot(np.maximum(qx, 0.0), np.maximum(qy, 0.0))
    inside = np.minimum(np.maximum(qx, qy), 0.0)
    return outside + inside - radius


MOMENTUM_FACTOR = 1.2 / JET_WIDTH
"""Integral of u^2 over a slot divided by q^2, for a parabolic jet with flow rate q."""


def slot_profile(grid: Grid) -> Array:
    """Return the velocity on the base's faces per unit action, shape (ny,): a parabola of flow rate +1 in the upper
    slot and -1 in the lower slot, averaged exactly over each face (paper, section 2.1)."""

    def flow_below(y: Array) -> Array:
        s = (y - (HALF_WIDTH - JET_WIDTH)) / JET_WIDTH
        return s**2 * (3.0 - 2.0 * s)

    profile = np.zeros(grid.shape[1])
    upper = slice(grid.upper - grid.slot_cells, grid.upper)
    edges = grid.yf[upper.start : upper.stop + 1]
    profile[upper] = np.diff(flow_below(edges)) / grid.dy[upper]
    # The lower slot's profile is a mirrored copy, so that the two flow rates cancel bit for bit.
    profile[grid.lower : grid.lower + grid.slot_cells] = -profile[upper][::-1]
    return profile


Terms = defaultdict[int, float]

_ARC_POINTS: Final = 64
"""Number of quadrature points on each rounded corner."""


class Surface:
    """The functionals of the flow on one grid. `viscosity` is 1 / Re; `profile` (ny,) is the velocity on the faces at
    `grid.rear` per unit action. The sensors of `layout` are on the sides and the base; no sensor is on the front."""

    def __init__(
        self, grid: Grid, boundary: Boundary, viscosity: float, profile: Array, body: BodyConfig, layout: SensorLayout
    ) -> None:
        self._grid, self._boundary, self._body = grid, boundary, body
        self._viscosity = viscosity
        self._numbers = Flow.numbered(grid.shape)
        # Each slot's profile has flow rate 1 or -1, so the weights of each slot sum to one.
        flow_rate = profile * grid.dy
        self._upper, self._lower = np.maximum(flow_rate, 0.0), np.maximum(-flow_rate, 0.0)
        self._slots = np.where(flow_rate != 0.0, grid.dy, 0.0)
        self._slot_stress = 4.0 * viscosity / float(grid.dx[grid.rear])
        rows = [
            self._wall_pressure(x, y, *normal)
            for (x, y), normal in zip(layout.positions, _normals(layout), strict=True)
        ]
        rows += self._wall_force()
        rows.append(self._terms("v", bilinear(*grid.axes("v"), *body.wake_probe)))
        self._sensors = len(layout)
        self._matrix = _sparse(rows, self._numbers.flat.size)

    def measure(self, flow: Flow, *, t: float = 0.0, action: float = 0.0) -> Sample:
        """Evaluate the functionals on a flow at time t. `action` is the jet flow rate in force."""
        values = self._matrix @ flow.flat
        rest = values[self._sensors :].tolist()
        face, ahead, _ = self._at_slots(flow)
        upper, lower = self.jet_pressures(flow)
        # The jets' kinetic power, the integral of u^3 over both slots, is zero: one slot blows and the other sucks.
        return Sample(
            t=t,
            Cp=values[: self._sensors],
            Cd=rest[0],
            Cl=rest[1],
            Cd_slot_pressure=-float(self._slot_pressure(flow) @ self._slots),
            Cd_slot_viscous=self._slot_stress * float((ahead - face) @ self._slots),
            Cd_momentum=-4.0 * MOMENTUM_FACTOR * action * action,
            jet_power=action * (upper - lower),
            Uy_probe=rest[2],
            action=action,
        )

    def jet_pressures(self, flow: Flow) -> tuple[float, float]:
        """Return the mean Cp over the upper and the lower slot, weighted by the jet profile."""
        pressure = self._slot_pressure(flow)
        return float(pressure @ self._upper), float(pressure @ self._lower)

    def weigh(self, bar: Flow, flow: Flow, weights: Sample, action: float) -> None:
        """Differentiate the sum of the sample's values, weighted by `weights`, by the flow; add the result to `bar`."""
        values = np.concatenate([weights.Cp, [weights.Cd, weights.Cl, weights.Uy_probe]])
        bar.flat[:] += values @ self._matrix
        face, _, between = self._at_slots(flow)
        blown = weights.jet_power * action
        on_slots = blown * self._upper - blown * self._lower - weights.Cd_slot_pressure * self._slots
        shear = weights.Cd_slot_viscous * self._slot_stress * self._slots
        rear = self._grid.rear
        bar.cells_p[rear] += 2.0 * on_slots
        bar.faces_u[rear] += 2.0 * on_slots * (between - 2.0 * face) - shear
        bar.faces_u[rear + 1] += 2.0 * on_slots * between + shear

    def _slot_pressure(self, flow: Flow) -> Array:
        face, _, between = self._at_slots(flow)
        return np.asarray(2.0 * (flow.cells_p[self._grid.rear] + between * between - face * face))

    def _at_slots(self, flow: Flow) -> tuple[Array, Array, Array]:
        """Return u on the base's faces, u on the next faces downstream, and the mean of these values."""
        face, ahead = flow.faces_u[self._grid.rear], flow.faces_u[self._grid.rear + 1]
        return face, ahead, 0.5 * (face + ahead)

    def _terms(self, component: Component, entries: list[tuple[tuple[int, int], float]]) -> Terms:
        numbers = self._numbers.unpadded(component)
        return defaultdict(float, {int(numbers[face]): w for face, w in entries})

    def _flow_points(self, x: float, y: float, nx: float, ny: float, component: Component) -> list[tuple[float, Terms]]:
        """Return the distances from the wall of the two nearest points on the normal at (x, y) to which `component` can
        be interpolated from values in the fluid only, each with the weights of the flow's values."""
        usable = {"u": self._boundary.open_u, "v": self._boundary.open_v, "p": self._boundary.fluid}[component]
        xs, ys = self._grid.axes(component)
        spacing = max(abs(nx) * _cell_size(self._grid.xf, x), abs(ny) * _cell_size(self._grid.yf, y))
        found: list[tuple[float, Terms]] = []
        distance = 0.5 * spacing
        while len(found) < 2:
            entries = bilinear(xs, ys, x + distance * nx, y + distance * ny)
            if all(usable[face] for face, _ in entries):
                found.append((distance, self._terms(component, entries)))
                distance += spacing
            else:
                distance += 0.0625 * spacing
        return found

    def _wall_pressure(self, x: float, y: float, nx: float, ny: float) -> Terms:
        """Return the weights with which the flow's values sum to Cp on the wall."""
        (d1, first), (d2, second) = self._flow_points(x, y, nx, ny, "p")
        scale = 2.0 / (d2 * d2 - d1 * d1)
        slope = self._wall_pressure_slope(x, y, nx, ny)
        return _combine((d2 * d2 * scale, first), (-d1 * d1 * scale, second), (-scale * d1 * d2 * (d2 - d1), slope))

    def _wall_pressure_slope(self, x: float, y: float, nx: float, ny: float) -> Terms:
        """Return the weights for the normal derivative of the kinematic pressure on a no-slip wall. By the momentum
        balance of fluid at rest, the derivative is nu d2(u.n)/dn2."""
        terms = Terms(float)
        components: tuple[tuple[float, Component], ...] = ((nx, "u"), (ny, "v"))
        for factor, component in components:
            if abs(factor) > 1e-9:
                (d1, first), (d2, second) = self._flow_points(x, y, nx, ny, component)
                scale = 2.0 * self._viscosity * factor / (d2 - d1)
                _add(terms, -scale / d1, first)
                _add(terms, scale / d2, second)
        return terms

    def _wall_shear(self, x: float, y: float, nx: float, ny: float, component: Component) -> Terms:
        """Return the weights for a velocity component's normal derivative on a no-slip wall, with second order."""
        (d1, first), (d2, second) = self._flow_points(x, y, nx, ny, component)
        scale = 1.0 / (d1 * d2 * (d2 - d1))
        return _combine((d2 * d2 * scale, first), (-d1 * d1 * scale, second))

    def _wall_force(self) -> tuple[Terms, Terms]:
        drag, lift = Terms(float), Terms(float)
        for x, y, nx, ny, length in self._wall_elements():
            pressure = self._wall_pressure(x, y, nx, ny)
            _add(drag, -nx * length, pressure)
            _add(lift, -ny * length, pressure)
            # On a no-slip wall the viscous traction is nu du/dn. It is tangential, because the flow is solenoidal.
            if abs(ny) > 1e-9:
                _add(drag, 2.0 * self._viscosity * length, self._wall_shear(x, y, nx, ny, "u"))
            if abs(nx) > 1e-9:
                _add(lift, 2.0 * self._viscosity * length, self._wall_shear(x, y, nx, ny, "v"))
        return drag, lift

    def _wall_elements(self) -> list[tuple[float, float, float, float, float]]:
        """Return midpoint, normal and length (x, y, nx, ny, length) of each outline element outside the slots."""
        grid, r, length = self._grid, self._body.leading_edge_radius, self._body.length
        flat = HALF_WIDTH - r
        slot = HALF_WIDTH - JET_WIDTH
        elements = [(0.0, y, -1.0, 0.0, dy) for y, dy in _strips(grid.yf, -flat, flat)]
        elements += [(length, y, 1.0, 0.0, dy) for y, dy in _strips(grid.yf, -slot, slot)]
        for x, dx in _strips(grid.xf, r, length):
            elements += [(x, HALF_WIDTH, 0.0, 1.0, dx), (x, -HALF_WIDTH, 0.0, -1.0, dx)]
        if r == 0.0:
            return elements
        step = 0.5 * np.pi / _ARC_POINTS
        for angle in (np.arange(_ARC_POINTS) + 0.5) * step:
            nx, ny = -float(np.cos(angle)), float(np.sin(angle))
            elements += [(r + r * nx, s * (flat + r * ny), nx, s * ny, r * step) for s in (1.0, -1.0)]
        return elements


def _normals(layout: SensorLayout) -> list[tuple[float, float]]:
    base = set(layout.base.tolist())
    return [(1.0, 0.0) if k in base else (0.0, float(np.sign(y))) for k, (_, y) in enumerate(layout.positions)]


def _cell_size(faces: Array, at: float) -> float:
    """Return the size of the cell around a point, or of the larger cell beside it, as for its mirror image."""
    first, last = np.searchsorted(faces, at, side="left") - 1, np.searchsorted(faces, at, side="right")
    return float(np.diff(faces[first : last + 1]).max())


def _strips(faces: Array, start: float, end: float) -> list[tuple[float, float]]:
    """Return midpoints and lengths of the grid's intervals, cut at `start` and `end`."""
    inside = faces[(faces > start + 1e-9) & (faces < end - 1e-9)]
    edges = np.concatenate([[start], inside, [end]])
    return [(float(m), float(w)) for m, w in zip(0.5 * (edges[1:] + edges[:-1]), np.diff(edges), strict=True)]


def _add(target: Terms, factor: float, terms: Terms) -> None:
    for index, weight in terms.items():
        target[index] += factor * weight


def _combine(*parts: tuple[float, Terms]) -> Terms:
    out = Terms(float)
    for factor, terms in parts:
        _add(out, factor, terms)
    return out


def _sparse(rows: list[Terms], columns: int) -> csr_array:
    start = np.cumsum([0, *(len(row) for row in rows)])
    index = np.concatenate([np.fromiter(row.keys(), np.int64) for row in rows])
    weight = np.concatenate([np.fromiter(row.values(), np.float64) for row in rows])
    return csr_array((weight, index, start), shape=(len(rows), columns))
