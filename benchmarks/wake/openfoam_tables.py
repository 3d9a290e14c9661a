"""The tables of the second plant next to the own one."""

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from benchmarks.common.markdown import read, table


def plants(results: Path) -> str:
    """Parts that have not been run are left out."""
    found = read(results / "openfoam.json")
    figures, facts = found["figures"], found["facts"]
    own = [row | {"case": f"stillwake, {row['case']}"} for row in read(results / "wake.json")["figures"]]
    paper = {"case": "paper", "St": 0.2, "base_Cp": -0.441, "Uy": 0.516}
    columns = {"Cd": "Cd (wall)", "Cl_std": "std Cl", "St": "Strouhal", "base_Cp": "mean base Cp"}
    last = {"Uy": "std Uy at (10, 0)", "cpu_s_per_t_c": "CPU s per t_c"}
    parts = [_rows("uncontrolled", [*figures["uncontrolled"], *own, paper], columns | last)]
    if "forced" in figures:
        slots = {"Cd_slot_pressure": "slot pressure", "Cd_slot_viscous": "slot viscous", "Cd_momentum": "momentum"}
        columns = {"Cd": "Cd (wall)", "Cl_std": "std Cl", "base_Cp": "mean base Cp", **slots}
        last = {"Cd_net": "net", "jet_power": "jet power", "cpu_s_per_t_c": "CPU s per t_c"}
        forced = facts["forced"]
        parts.append(f"\nA sine of amplitude {forced['amplitude']:g} and frequency {forced['frequency']:g}:\n")
        parts.append(_rows("forced", figures["forced"], columns | last))
    if "loop" in figures:
        columns = {"Cd_uncontrolled": "Cd before", "Cd_controlled": "Cd under control"}
        columns |= {"reduction_percent": "less drag, %", "base_Cp_controlled": "base Cp"}
        last = {"abs_Cl_controlled": "mean abs Cl", "mean_Cl_controlled": "mean Cl", "rms_action": "rms action"}
        loop = facts["loop"]
        parts.append(
            f"\nThe shipped bundle in the closed loop, {loop['lead_in']:g} t_c without control and "
            f"{loop['controlled']:g} with it, of which the first {loop['settle']:g} are left out:\n"
        )
        parts.append(_rows("closed loop", figures["loop"], columns | last))
    return "\n".join(parts)


def loop(results: Path) -> str:
    """The shipped release in the closed loop on both plants."""
    columns = {
        "Cd_uncontrolled": "Cd before",
        "Cd_controlled": "Cd under control",
        "reduction_percent": "less drag, %",
        "Cd_net_uncontrolled": "with slots and jets before",
        "Cd_net_controlled": "under control",
        "base_Cp_controlled": "base Cp",
        "abs_Cl_uncontrolled": "mean abs Cl before",
        "abs_Cl_controlled": "under control",
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
            f"  {figures['cycles_controlled']} shedding cycles from {facts['settle']:g} t_c after the request on; of "
            f"{figures['frames_sent']} frames {figures['frames_lost']} lost."
        )
    return "\n".join([_rows("closed loop", rows, columns), "", *notes])


def _rows(first: str, rows: Iterable[Mapping[str, Any]], columns: Mapping[str, str]) -> str:
    """A table of rows that name their case; a figure that a row lacks stays empty."""
    return table((first, *columns.values()), [(row["case"], *(row.get(name) for name in columns)) for row in rows])
