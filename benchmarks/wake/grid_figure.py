"""Mean and fluctuating Cp along the body: our grids over the OpenFOAM reference."""

from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from benchmarks.common.markdown import read
from benchmarks.wake.tables import REFERENCE, rows_by_grid
from contract import sensors


def draw(results: Path) -> Figure:
    """Upper and lower side are averaged: the mean flow is symmetric."""
    rows, reference = rows_by_grid(results), read(REFERENCE)
    figure = Figure(figsize=(9.0, 5.2), dpi=110, layout="constrained")
    grid = figure.subplots(2, 2, sharey="row", width_ratios=(3, 1))
    places = sensors.positions()
    side, base = places[: sensors.PER_SIDE, 0], places[sensors.BASE, 1]
    for line, (name, label) in zip(grid, (("Cp_mean", "mean $C_p$"), ("Cp_std", "std $C_p$")), strict=True):
        for row in rows:
            along, across = _folded(row[name])
            line[0].plot(side, along, linewidth=1.2, label=row["case"].partition(",")[0])
            line[1].plot(base, across, linewidth=1.2)
        along, across = _folded(reference[name])
        line[0].plot(side, along, "k.", markersize=5, label="OpenFOAM, 33k cells")
        line[1].plot(base, across, "k.", markersize=5)
        line[0].set_ylabel(label)
        for axes in line:
            axes.grid(color="0.9")
    grid[0, 0].legend(fontsize=8, loc="lower right")
    grid[1, 0].set_xlabel("x / W along the sides")
    grid[1, 1].set_xlabel("y / W on the base")
    return figure


def _folded(values: list[float]) -> tuple[np.ndarray[Any, Any], np.ndarray[Any, Any]]:
    n, array = sensors.PER_SIDE, np.array(values)
    base = array[sensors.BASE]
    return 0.5 * (array[:n] + array[n : 2 * n]), 0.5 * (base + base[::-1])
