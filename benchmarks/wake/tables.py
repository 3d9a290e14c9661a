"""The tables of the plant: time of a time step, and the second plant."""

from typing import Any

from benchmarks.common.markdown import table


def steps(found: Any) -> str:
    """Return the table of the computing time of a time step, for each mesh and precision."""
    names = ("cpu_s_per_t_c", "forced_cpu_s_per_t_c", "ns_per_cell_and_step", "floor_sweeps_ns", "floor_transforms_ns")
    rows = []
    for row in found["figures"]:
        poisson = f"{100 * row['shares']['Poisson']:.0f}"
        rows.append((f"{row['cells']:,}, {row['precision']}", *(row[name] for name in names), poisson))
    heads = (
        "cells", "CPU s per t_c", "at full amplitude", "ns per cell and step", "floor: memory", "floor: transforms",
        "Poisson, %",
    )  # fmt: skip
    return table(heads, rows)


def openfoam_loop(*loops: Any) -> str:
    """Return the table of the closed loop on each plant."""
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
    for found in loops:
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


def openfoam_drive(*drives: Any) -> str:
    """Return the table of a drive on each plant."""
    columns = {
        "reduction_percent": "less drag, %",
        "net_reduction_percent": "less net energy, %",
        "drag_kJ_per_km_without": "drag without control, kJ/km",
        "drag_kJ_per_km": "with control",
        "abs_Cl_without": "mean abs Cl without control",
        "abs_Cl": "with control",
    }
    rows = [(found["facts"]["plant"], *(found["figures"]["drive"][name] for name in columns)) for found in drives]
    return table(("plant", *columns.values()), rows)
