"""The limits of a stable time step of the explicit scheme.

The convective number of a cell is dt (|u| / dx + |v| / dy). The viscous number is 4 nu dt (1 / dx^2 + 1 / dy^2). The
stability region of a three-stage Runge-Kutta scheme of order 3 ends at 1.73 on the imaginary axis, at 2.0 to 2.4 with
the viscosity of this flow, and at 2.51 on the real axis. Runs of the uncontrolled truck are stable with a number of 2.0
at the front corners and diverge at 2.3. Next to the jets, flow is fast in few cells and for a short time. With full
reversals over 100 control periods, runs are stable with a number of 4.0 there and diverge at 4.3.
"""

from math import ceil
from typing import Final

import numpy as np
import numpy.typing as npt

from contract.errors import PlantError
from wake.solver.flow import Flow
from wake.solver.grid import Grid

CONVECTIVE_LIMIT: Final = 2.0
JET_LIMIT: Final = 4.0
VISCOUS_LIMIT: Final = 2.51

_SAFE: Final = 1.7
"""Largest convective and viscous number of the time step that `advice` recommends."""


def advice(grid: Grid, before: Flow, viscosity: float, dt: float) -> str:
    """Return a message for a time step with which the flow `before` diverged. It states the largest numbers of all
    cells, and a stable time step."""
    u, v = np.abs(before.faces_u), np.abs(before.faces_v)
    along = np.maximum(u[:-1], u[1:]) / grid.dx[:, None]
    across = np.maximum(v[:, :-1], v[:, 1:]) / grid.dy
    convective = float(dt * (along + across).max())
    viscous = float(4.0 * viscosity * dt * (1.0 / grid.dx.min() ** 2 + 1.0 / grid.dy.min() ** 2))
    held = dt / max(2.0, convective / _SAFE, viscous / _SAFE)
    return (
        f"convective number {convective:.2f} before, must be below {CONVECTIVE_LIMIT:g}; viscous number "
        f"{viscous:.2f}, must be below {VISCOUS_LIMIT:g}: take dt = {held:.2g}"
    )


def check_step(
    grid: Grid, fluid: npt.NDArray[np.bool_], viscosity: float, jet_speed: float, period: float, substeps: int
) -> None:
    """Check that a time step is not too large for this grid, before any flow exists. Raises PlantError with the number
    that is too large and the sufficient number of substeps. `jet_speed` is the largest jet speed that can be commanded,
    in U_inf; `period` is the control period in t_c."""
    dt = period / substeps
    per_x, per_y = 1.0 / grid.dx[:, None], 1.0 / grid.dy
    slot = slice(grid.upper - grid.slot_cells, grid.upper)
    # At the front corners, both velocity components reach about the free-stream speed. A blowing jet turns by 90
    # degrees within one cell, so both components reach the jet's speed. A sucking jet draws an equal flow along the
    # base.
    numbers = (
        ("convective number of the free stream", np.where(fluid, per_x + per_y, 0.0).max(), CONVECTIVE_LIMIT),
        ("convective number of the jets", jet_speed * (per_x[grid.rear, 0] + per_y[slot].max()), JET_LIMIT),
        ("viscous number", 4.0 * viscosity * np.where(fluid, per_x**2 + per_y**2, 0.0).max(), VISCOUS_LIMIT),
    )
    name, rate, limit = max(numbers, key=lambda entry: entry[1] / entry[2])
    if dt * rate > limit:
        raise PlantError(
            f"dt = {dt:.3g} ({period:g} t_c in {substeps} substeps): {name} {dt * rate:.2f} on this grid, must be "
            f"below {limit:g}: take at least {ceil(period * rate / limit)} substeps"
        )
