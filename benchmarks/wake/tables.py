"""The tables of the plant: time of a time step, and the second plant."""

from pathlib import Path

from benchmarks.common.markdown import read, table


def tables(results: Path) -> dict[str, str]:
    """Return the text of each table, by the table's name in the pages."""
    return {
        "steps": _steps(results),
        "openfoam_loop": _openfoam_loop(results),
    }


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
