"""The tables of the shipped release from several starting phases in the shedding cycle and at other speeds."""

import re
from collections import Counter
from pathlib import Path

from benchmarks.common.markdown import read, table

_HEADS = ("", "less drag, %", "mean abs Cl", "mean Cl", "rms action", "jet power", "less Cd_net, %", "less power, %")
_NAMES = (
    *("reduction_percent", "abs_Cl_controlled", "mean_Cl_controlled", "rms_action", "jet_power_controlled"),
    *("net_reduction_percent", "net_of_power_percent"),
)


def tables(results: Path) -> dict[str, str]:
    """Return the text of each table, by the table's name in the pages."""
    return {
        "release_loop": release_loop(results),
        "drive": drive(results),
    }


def drive(results: Path) -> str:
    """Return the table of the shipped release at other speeds."""
    found = read(results / "drive.json")
    facts = found["facts"]
    rows = [
        (
            f"{row['name']} ({row['bundle']})" if "bundle" in row else row["name"],
            f"{row['reduction_percent']:.1f} ({row['reduction_least']:.1f} to {row['reduction_most']:.1f})",
            f"{row['net_reduction_percent']:.1f}",
            *(f"{row[name]:.2f}" for name in ("abs_Cl", "abs_Cl_without")),
            f"{row['in_control_percent']:.0f} {_latched(row['trouble'])}".strip(),
        )
        for row in found["figures"]
    ]
    heads = (
        "drive",
        "less drag, % (range of starts)",
        "less Cd_net, %",
        "mean abs Cl",
        "without control",
        "in control, % (latched fault, starts)",
    )
    return f"""{table(heads, rows)}

Measured on {found["date"]}: {facts["bundle"]} ({facts["digest"][:12]}), refinement {facts["mesh"]:g}, medians of
{facts["phases"]} starts in one shedding cycle: {facts["lead_in"]:g} t_c at the design speed without control, then the
drive. Averages leave out the drive's first {facts["settle"]:g} t_c."""


def _latched(troubles: list[str]) -> str:
    """Return a text with the latched faults in the runs from all starts, each with the number of its occurrences."""
    faults = Counter(re.findall(r"ECU FAULT: (\w+)", " ".join(troubles)))
    return ", ".join(f"{name} ({count})" for name, count in faults.items())


def release_loop(results: Path) -> str:
    """Return the table of the shipped release over several starting phases."""
    found = read(results / "release_loop.json")
    figures, facts = found["figures"], found["facts"]
    spread = figures["over_phases"]
    rows = [
        (f"mean of {len(figures['phases'])} starts", *(spread[name]["mean"] for name in _NAMES)),
        ("95 % confidence interval of the mean, +-", *(spread[name]["half_width_95"] for name in _NAMES)),
        ("smallest..largest", *(f"{spread[name]['least']:.4g}..{spread[name]['most']:.4g}" for name in _NAMES)),
    ]
    before, under = (spread[f"Cd_net_{name}"]["mean"] for name in ("uncontrolled", "controlled"))
    return f"""Measured on {found["date"]}: {facts["bundle"]}, {facts["lead_in"]:g} t_c without control, then
{facts["controlled"]:g} t_c with control, averaged over the last {facts["controlled"] - facts["settle"]:g} t_c. Mean
`Cd_net` is {before:.4f} without control and {under:.4f} with control.

{table(_HEADS, rows)}"""
