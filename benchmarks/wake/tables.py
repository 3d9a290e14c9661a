"""The tables of the plant: time of a time step, live wake, adjoint, square cylinder, and the second plant."""

from pathlib import Path
from typing import Any, Final

from benchmarks.common.markdown import read, table

LITERATURE: Final = (
    ("Sohankar, Norberg and Davidson 1998, blockage 5 %", "0.146", "1.44 to 1.48", "0.13 to 0.19"),
    ("Sharma and Eswaran 2004, blockage 5 %", "0.149", "1.49", "0.19"),
)
"""Strouhal number, mean drag of all faces and rms lift of a square cylinder at Re = 100, from Int. J. Numer. Meth.
Fluids 26 (1998) 39-56 and Numer. Heat Transfer A 45 (2004) 247-269."""


def tables(results: Path) -> dict[str, str]:
    """Return the text of each table, by the table's name in the pages."""
    return {
        "steps": _steps(results),
        "adjoint": _adjoint(results),
        "horizon": horizon(read(results / "horizon.json")),
        "vector_env": vector(read(results / "vector_env.json")),
        "square": _square(results),
        "openfoam_loop": _openfoam_loop(results),
    }


def _square(results: Path) -> str:
    names = ("St", "Cd_all_faces", "Cd", "Cd_slot", "Cd_momentum_balance", "Cl_std", "base_Cp")
    rows: list[tuple[object, ...]] = [
        (f"stillwake {row['case']}", *(row[name] for name in names)) for row in read(results / "square.json")["figures"]
    ]
    rows += [(name, *figures, *[None] * 3, lift, None) for name, *figures, lift in LITERATURE]
    heads = ("", "Strouhal", "Cd all faces", "wall Cd", "slots", "Cd from the momentum balance", "std Cl", "base Cp")
    return table(heads, rows)


def _steps(results: Path) -> str:
    rows = []
    for row in read(results / "wake_speed.json")["figures"]:
        rows.append(
            (
                f"{row['cells']:,}, {row['precision']}",
                row["cpu_s_per_t_c"],
                row["forced_cpu_s_per_t_c"],
                row["ns_per_cell_and_step"],
                row["floor_sweeps_ns"],
                row["floor_transforms_ns"],
                f"{100 * row['shares']['Poisson']:.0f}",
            )
        )
    heads = (
        "cells", "CPU s per t_c", "at full amplitude", "ns per cell and step", "floor: memory", "floor: transforms",
        "Poisson, %",
    )  # fmt: skip
    return table(heads, rows)


def _adjoint(results: Path) -> str:
    names = (
        "precision", "cells", "gradient_error", "forward_ms", "recording_ratio", "periods_ratio",
        "gradient_periods_per_s", "memory_mb",
    )  # fmt: skip
    heads = (
        "precision", "cells", "error of the gradient", "forward, ms", "recorded / forward", "backward / forward",
        "gradient periods per second", "MB stored",
    )  # fmt: skip
    return table(heads, [tuple(row[name] for name in names) for row in read(results / "adjoint.json")["figures"]])


def horizon(found: Any) -> str:
    """Return the table of a gradient's errors relative to finite differences, for each length of the window."""
    rows = [(row["window"], row["gradient"], *(_percent(error) for error in row["errors"])) for row in found["figures"]]
    steps = (f"step of {_percent(share)} of the bound" for share in found["facts"]["steps"])
    return table(("window, t_c", "gradient", *steps), rows)


def _percent(share: float) -> str:
    return f"{100.0 * share:.2g} %"


def vector(found: Any) -> str:
    """Return the table of the number of steps and gradients per second in a batch."""
    names = {"sync": "SyncVectorEnv", "async": "AsyncVectorEnv", "vector_entry_point": "vector_entry_point"}
    figures, count = found["figures"], found["facts"]["envs"]
    gradients = {"sync": "one after another", "vector_entry_point": "batch"}
    rows = [
        (name, figures["steps_per_s"][mode], figures["gradient_periods_per_s"].get(gradients.get(mode)))
        for mode, name in names.items()
    ]
    return table((f"{count} wakes", "steps per second", "gradient periods per second"), rows)


def _openfoam_loop(results: Path) -> str:
    columns = {
        "Cd_uncontrolled": "Cd without control",
        "Cd_controlled": "Cd with control",
        "reduction_percent": "less drag, %",
        "Cd_net_uncontrolled": "Cd_net without control",
        "Cd_net_controlled": "Cd_net with control",
        "base_Cp_controlled": "base Cp",
        "abs_Cl_uncontrolled": "mean abs Cl without control",
        "abs_Cl_controlled": "mean abs Cl with control",
        "mean_Cl_controlled": "mean Cl",
        "rms_action": "rms action",
        "jet_power_controlled": "jet power",
    }
    rows, notes = [], []
    for name in ("demo", "openfoam_loop"):
        found = read(results / f"{name}.json")
        figures, facts = found["figures"], found["facts"]
        rows.append(figures | {"case": facts["plant"]})
        notes.append(
            f"- {facts['plant']}: {figures['controller']}, {found['date']};\n"
            f"  means of {figures['cycles_controlled']} shedding cycles, {facts['settle']:g} t_c after the request; "
            f"{figures['frames_lost']} of {figures['frames_sent']} frames lost."
        )
    heads = ("closed loop", *columns.values())
    cells = [(row["case"], *(row.get(name) for name in columns)) for row in rows]
    return "\n".join([table(heads, cells), "", *notes])
