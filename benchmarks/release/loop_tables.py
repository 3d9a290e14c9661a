"""The tables of the shipped release from several starting phases in the shedding cycle, at other speeds, in the
campaign, on the second plant, and compared with other ways to reduce drag."""

import re
from collections import Counter
from collections.abc import Mapping
from typing import Any

from benchmarks.common.documents import table

_HEADS = ("", "less drag, %", "mean abs Cl", "mean Cl", "rms action", "jet power", "less Cd_net, %", "less power, %")
_NAMES = (
    *("reduction_percent", "abs_Cl_controlled", "mean_Cl_controlled", "rms_action", "jet_power_controlled"),
    *("net_reduction_percent", "net_of_power_percent"),
)


def drive(found: Any) -> str:
    """Return the table of the shipped release at other speeds."""
    facts = found["facts"]
    rows = [
        (
            row["name"],
            f"{row['reduction_percent']:.1f} ({row['reduction_least']:.1f} to {row['reduction_most']:.1f})",
            f"{row['net_reduction_percent']:.1f}",
            *(f"{row[name]:.2f}" for name in ("abs_Cl", "abs_Cl_without")),
            f"{row['in_control_percent']:.0f} {_latched(row['trouble'])}".strip(),
        )
        for row in found["figures"]
    ]
    heads = ("drive", "less drag, % (range of starts)", "less Cd_net, %", "mean abs Cl", "without control")
    return f"""{table((*heads, "in control, % (latched fault, starts)"), rows)}

Measured on {found["date"]}: {facts["bundle"]} ({facts["digest"][:12]}), refinement {facts["mesh"]:g}, medians of
{facts["phases"]} starts in one shedding cycle: {facts["lead_in"]:g} t_c at the design speed without control, then the
drive. Averages leave out the drive's first {facts["settle"]:g} t_c."""


def _latched(troubles: list[str]) -> str:
    """Return a text with the latched faults in the runs from all starts, each with the number of its occurrences."""
    faults = Counter(re.findall(r"ECU FAULT: (\w+)", " ".join(troubles)))
    return ", ".join(f"{name} ({count})" for name, count in faults.items())


def release_loop(found: Any) -> str:
    """Return the table of the shipped release over several starting phases."""
    figures, facts = found["figures"], found["facts"]
    spread = figures["over_phases"]
    rows = [
        (f"mean of {len(figures['phases'])} starts", *(spread[name]["mean"] for name in _NAMES)),
        ("95 % confidence interval of the mean, +-", *(spread[name].get("half_width_95") for name in _NAMES)),
        ("smallest..largest", *(f"{spread[name]['least']:.4g}..{spread[name]['most']:.4g}" for name in _NAMES)),
    ]
    before, under = (spread[f"Cd_net_{name}"]["mean"] for name in ("uncontrolled", "controlled"))
    return f"""Measured on {found["date"]}: {facts["bundle"]}, {facts["lead_in"]:g} t_c without control, then
{facts["controlled"]:g} t_c with control, averaged over the last {facts["controlled"] - facts["settle"]:g} t_c. Mean
`Cd_net` is {before:.4f} without control and {under:.4f} with control.

{table(_HEADS, rows)}"""


def campaign(found: Any) -> str:
    """Return the matrix with a row per scenario."""
    rows = [
        (
            row["name"],
            row["use"] if row["safe"] else f"**UNSAFE**, {row['use']}",
            _with_range("..", *(_number(row[f"reduction_percent{end}"], ".1f") for end in ("", "_min", "_max"))),
            _number(row["abs_Cl"], ".2f"),
            _in_control(row),
        )
        for row in found["figures"]
    ]
    heads = ("scenario", "use", "less drag, %", "mean abs Cl", "in control, % (latched)")
    facts, figures = found["facts"], found["figures"]
    safe = sum(row["safe"] for row in figures)
    return f"""{table(heads, rows)}

Measured on {found["date"]} with {facts["bundle_name"]}: means of {facts["phases"]} starting phases, with the smallest
and largest value. If the last column is empty, the ECU was always in control; brackets contain the number of starts in
which a fault latched. Control lasts {facts["controlled"]:g} t_c; averages are over the last
{facts["controlled"] - facts["settle"]:g} t_c. {safe} of {len(figures)} scenarios are safe."""


def _in_control(row: Mapping[str, Any]) -> str:
    """Return the percentage of periods in control, with the number of latched faults in brackets if there are any.
    Without latched faults, 100 % is left out."""
    share = _number(row["in_control_percent"], ".0f")
    return f"{share} ({row['latches']})" if row["latches"] else "" if share == "100" else share


def _with_range(to: str, mean: str, least: str, most: str) -> str:
    return mean if least == most else f"{mean} ({least}{to}{most})"


def _number(value: float | None, style: str) -> str:
    return "-" if value is None else f"{value:{style}}"


_DEFAULT_MESH = (443, 164)


def roads(found: Any, phases: Any) -> str:
    """Return the table that compares several ways to reduce drag."""
    rows = []
    for row in found["figures"]:
        loop = "bus" if row["loop"] == "CAN" else "no bus"
        rows.append(
            (
                row["title"],
                _with_range(" to ", *(f"{row[f'{name}reduction_percent']:.1f}" for name in ("", "least_", "most_"))),
                *(f"{row['abs_Cl']:.3f}", f"{row['jet_power']:.3f}", f"{row['net_reduction_percent']:.1f}"),
                *(f"{row['interactions']:,}", loop if tuple(row["mesh"]) == _DEFAULT_MESH else f"{loop}, coarse"),
                row["phases"],
            )
        )
    spread = phases["figures"]["over_phases"]
    drag, lift, power, net = (spread[name] for name in (_NAMES[0], _NAMES[1], _NAMES[4], _NAMES[5]))
    rows.append(
        (
            f"the shipped release ({phases['facts']['bundle']})",
            f"{drag['mean']:.1f} ({drag['least']:.1f} to {drag['most']:.1f})",
            *(f"{lift['mean']:.3f}", f"{power['mean']:.3f}", f"{net['mean']:.1f}", "", "bus"),
            len(phases["figures"]["phases"]),
        )
    )
    heads = ("road", "less drag, %", "mean abs Cl", "jet power", "less net drag, %", "steps", "loop", "starts")
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
