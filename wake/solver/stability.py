"""How long a time step the explicit scheme carries.

The convective number of a cell is dt (|u| / dx + |v| / dy), the viscous one 4 nu dt (1 / dx^2 + 1 / dy^2). The
stability polynomial of a three-stage Runge-Kutta scheme of order 3 ends at 1.73 on the imaginary axis, at 2.0 to 2.4
with the viscosity of this flow, and at 2.51 on the real axis. The uncontrolled truck bears this out: it keeps a number
of 2.0 at its front corners and diverges at 2.3. Next to the jets, where few cells are fast and not for long, 4.0 holds
over 100 control periods of full reversals and 4.3 does not.
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
"""What to aim at in either number."""


def convective_number(grid: Grid, flow: Flow, dt: float) -> float:
    """Largest convective number of the cells."""
    u, v = np.abs(flow.faces_u), np.abs(flow.faces_v)
    along = np.maximum(u[:-1], u[1:]) / grid.dx[:, None]
    across = np.maximum(v[:, :-1], v[:, 1:]) / grid.dy
    return float(dt * (along + across).max())


def viscous_number(grid: Grid, viscosity: float, dt: float) -> float:
    """Largest viscous number of the cells."""
    return float(4.0 * viscosity * dt * (1.0 / grid.dx.min() ** 2 + 1.0 / grid.dy.min() ** 2))


def advice(convective: float, viscous: float, dt: float) -> str:
    """The numbers of a time step with which the flow diverged, and a step that holds."""
    held = dt / max(2.0, convective / _SAFE, viscous / _SAFE)
    return (
        f"convective number {convective:.2f} before, must be below {CONVECTIVE_LIMIT:g}; viscous number "
        f"{viscous:.2f}, must be below {VISCOUS_LIMIT:g}: take dt = {held:.2g}"
    )


def check_step(
    grid: Grid, fluid: npt.NDArray[np.bool_], viscosity: float, jet_speed: float, period: float, substeps: int
) -> None:
    """Refuse a time step that is bound to diverge on this grid, before any flow exists. Raises PlantError with the
    number that is too large and the substeps that would do.

    Args:
        fluid: its fluid cells, (nx, ny).
        viscosity: 1 / Re.
        jet_speed: the fastest the jets can be asked to blow, in U_inf.
        period: control period in t_c.
    """
    dt = period / substeps
    per_x, per_y = 1.0 / grid.dx[:, None], 1.0 / grid.dy
    slot = slice(grid.upper - grid.slot_cells, grid.upper)
    # The free stream passes the front corners at about its own speed in both directions; a jet that blows turns
    # within a cell, and one that sucks draws as much along the base.
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
