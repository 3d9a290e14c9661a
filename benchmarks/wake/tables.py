"""The tables of the plant: grids, forcing, cost of a time step, and the second plant."""

from pathlib import Path
from typing import Any, Final

import numpy as np

from benchmarks.common.markdown import read, table
from benchmarks.wake import openfoam_tables, square

REFERENCE: Final = Path(__file__).with_name("reference") / "openfoam_uncontrolled.json"

# The other rows of the same reference, and the paper's own (168,000 cells; drag of all faces, hence no wall drag).
_OTHER_ROWS: Final = (
    ("OpenFOAM 33k cells, pimpleFoam, 2 outer correctors", 1.060, None, 1.047, 0.1993, -0.476, 0.532),
    ("OpenFOAM 10k cells, icoFoam, dt 0.02", 1.067, None, 0.966, 0.193, -0.445, 0.509),
    ("paper, OpenFOAM 168k cells (1.051 with the slots)", None, None, None, 0.2, -0.441, 0.516),
)


def tables(results: Path) -> dict[str, str]:
    """Every table by its marker."""
    return {
        "grids": _grids(results),
        "limit": _limit(results),
        "forced": _forced(results),
        "steps": _steps(results),
        "live": _live(results),
        "open_loop": _open_loop(results),
        "square": _square(results),
        "plants": openfoam_tables.plants(results),
        "openfoam_loop": openfoam_tables.loop(results),
    }


def rows_by_grid(results: Path) -> list[dict[str, Any]]:
    """The study's cases whose time step follows the grid, coarsest first."""
    rows: list[dict[str, Any]] = read(results / "wake.json")["figures"]
    return [row for row in rows if row["steps_per_period"] == round(30 * max(1.0, row["refinement"]))]


def _grids(results: Path) -> str:
    reference = read(REFERENCE)
    target = np.array(reference["Cp_mean"])
    names = ("Cd", "Cd_slot", "Cl_std", "St", "base_Cp", "Uy")
    rows: list[tuple[object, ...]] = [
        (f"stillwake {row['case']}", *(row[name] for name in names), _rms(row, target))
        for row in read(results / "wake.json")["figures"]
    ]
    rows.append(("OpenFOAM 33k cells, icoFoam, dt 0.01", *(reference[name] for name in names), None))
    rows += [(*row, None) for row in _OTHER_ROWS]
    heads = ("", "wall Cd", "slots", "std Cl", "Strouhal", "base Cp", "std Uy at (10, 0)", "rms Cp difference")
    return table(heads, rows)


def _square(results: Path) -> str:
    names = ("St", "Cd_all_faces", "Cd", "Cd_slot", "Cd_momentum_balance", "Cl_std", "base_Cp")
    rows: list[tuple[object, ...]] = [
        (f"stillwake {row['case']}", *(row[name] for name in names)) for row in read(results / "square.json")["figures"]
    ]
    rows += [(name, *figures, *[None] * 3, lift, None) for name, *figures, lift in square.LITERATURE]
    heads = ("", "Strouhal", "Cd all faces", "wall Cd", "slots", "Cd from the momentum balance", "std Cl", "base Cp")
    return table(heads, rows)


def _rms(row: dict[str, Any], target: np.ndarray[Any, Any]) -> float:
    return float(np.sqrt(np.mean((np.array(row["Cp_mean"]) - target) ** 2)))


def _limit(results: Path) -> str:
    """Richardson extrapolation, second order, from the two finest grids."""
    rows = rows_by_grid(results)
    coarse, fine = rows[-2], rows[-1]
    ratio = (fine["refinement"] / coarse["refinement"]) ** 2
    names = ("Cd", "all_faces", "momentum", "Cl_std", "St", "base_Cp", "Uy")
    lines: list[tuple[object, ...]] = []
    for row in rows:
        lines.append((row["case"], *(_figure(row, name) for name in names)))
    limits = [_figure(fine, n) + (_figure(fine, n) - _figure(coarse, n)) / (ratio - 1.0) for n in names]
    lines.append(("limit, from the two finest", *limits))
    heads = ("", "wall Cd", "Cd all faces", "Cd from the momentum balance", "std Cl", "Strouhal", "base Cp", "std Uy")
    return table(heads, lines)


def _figure(row: dict[str, Any], name: str) -> float:
    if name == "all_faces":
        return float(row["Cd"] + row["Cd_slot"])
    return float(row["Cd_momentum_balance" if name == "momentum" else name])


def _forced(results: Path) -> str:
    names = ("Cd", "Cd_slot", "Cd_momentum", "jet_power", "Cl_std", "base_Cp", "Uy")
    rows = [
        (row["case"], row["Cd"], *(row[f"forced_{name}"] for name in names), row["forced_Cd_std"])
        for row in read(results / "wake.json")["figures"]
    ]
    heads = (
        "", "wall Cd, no forcing", "wall Cd", "slots", "jet momentum", "jet power", "std Cl", "base Cp", "std Uy",
        "std Cd",
    )  # fmt: skip
    return table(heads, rows)


def _steps(results: Path) -> str:
    rows = []
    for row in read(results / "wake_speed.json")["figures"]:
        shares = ", ".join(f"{label} {100 * share:.0f} %" for label, share in row["shares"].items())
        rows.append(
            (
                f"{row['cells']:,}",
                row["cpu_s_per_t_c"],
                row["forced_cpu_s_per_t_c"],
                row["ns_per_cell_and_step"],
                row["floor_sweeps_ns"],
                row["floor_transforms_ns"],
                shares,
            )
        )
    heads = (
        "cells", "CPU s per t_c", "at full amplitude", "ns a cell and step", "floor: memory", "floor: transforms",
        "shares",
    )  # fmt: skip
    return table(heads, rows)


def _live(results: Path) -> str:
    heads = (
        "refinement", "grid, time step", "cells a slot", "ms a control period", "of processor time", "wall Cd",
        "std Cl", "Strouhal", "reduction under control, %", "mean abs Cl before", "under control",
    )  # fmt: skip
    names = (
        "refinement", "case", "slot_cells", "period_ms", "cpu_ms", "Cd", "Cl_std", "St", "reduction_percent",
        "abs_Cl_uncontrolled", "abs_Cl_controlled",
    )  # fmt: skip
    return table(heads, [tuple(row[name] for name in names) for row in read(results / "live_speed.json")["figures"]])


def _open_loop(results: Path) -> str:
    names = ("Cd", "base_Cp", "abs_Cl", "mean_Cl", "rms_action", "Cd_net", "jet_power")
    found = read(results / "open_loop.json")
    facts = found["facts"]
    rows = [[f"{row['frequency']:.2f}", row["lead"], *(row[name] for name in names)] for row in found["figures"]]
    span = f"{facts['settle']:g} to {facts['controlled']:g} t_c"
    return f"""Measured on {found["date"]}, averages over the whole cycles of the sine in {span}.

{table(("frequency", "begins after", *names), rows)}"""
