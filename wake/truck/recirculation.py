"""The length of the recirculation bubble downstream of the body."""

import numpy as np

from wake.solver.flow import Flow
from wake.solver.grid import Grid


def recirculation_length(grid: Grid, flow: Flow) -> float:
    """Return the distance in W, in a steady or mean flow, from the base to the last point on the axis y = 0 where u
    turns positive.

    The length is zero if there is no backward flow on the axis; a bubble that reaches the outlet ends there.
    """
    # The axis is a row of faces, so u is stored half a cell below and above the axis.
    above = grid.shape[1] // 2
    speed = flow.faces_u[grid.rear :, above - 1 : above + 1].mean(axis=1)
    x = grid.xf[grid.rear :] - grid.xf[grid.rear]
    upstream = np.flatnonzero(speed < 0.0)
    if len(upstream) == 0:
        return 0.0
    last = int(upstream[-1])
    if last == len(x) - 1:
        return float(x[-1])
    share = speed[last] / (speed[last] - speed[last + 1])
    return float(x[last] + share * (x[last + 1] - x[last]))
