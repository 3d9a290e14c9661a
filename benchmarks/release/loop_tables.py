"""The tables of the shipped release from several phases and at other speeds, and of what a search found."""

import re
from collections import Counter
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from benchmarks.common.markdown import read, table

_HEADS = ("", "less drag, %", "mean abs Cl", "mean Cl", "rms action", "jet power", "less Cd_net, %", "less power, %")
_NAMES = (
    *("reduction_percent", "abs_Cl_controlled", "mean_Cl_controlled", "rms_action", "jet_power_controlled"),
    *("net_reduction_percent", "net_of_power_percent"),
)


def tables(results: Path) -> dict[str, str]:
    """Every table by its marker."""
    return {
        "release_loop": release_loop(results),
        "square_loop": release_loop(results, "square_loop"),
        "drive": drive(results),
        "tune": tune(results),
        "tune_settings": tune_settings(results),
    }


def drive(results: Path) -> str:
    """The shipped release at other speeds."""
    found = read(results / "drive.json")
    facts = found["facts"]
    rows = [
        (
            row["name"],
            row["reduction_percent"],
            f"{row['reduction_least']:.1f} .. {row['reduction_most']:.1f}",
            row["net_reduction_percent"],
            *(f"{row[name]:.0f}" for name in ("drag_kJ_per_km_without", "drag_kJ_per_km", "jets_kJ_per_km")),
            *(f"{row[name]:.2f}" for name in ("abs_Cl", "abs_Cl_without")),
            f"{row['in_control_percent']:.0f}",
            _latched(row["trouble"]),
        )
        for row in found["figures"]
    ]
    heads = ("drive", "less drag, %", "by start", "less net, %", "kJ a km without", "with", "of the jets")
    shown = table((*heads, "mean abs Cl", "without", "in control, %", "latched (starts)"), rows)
    return f"""{shown}

Measured on {found["date"]}: {facts["bundle"]} ({facts["digest"][:12]}), mesh {facts["mesh"]:g}, medians of
{facts["phases"]} starts in one shedding cycle, {facts["lead_in"]:g} t_c of the design speed without control, then the
drive, of which the first {facts["settle"]:g} t_c do not count. Energies are per metre of height."""


def _latched(troubles: list[str]) -> str:
    """Faults of all starts, each with how many of them it ended."""
    faults = Counter(re.findall(r"ECU FAULT: (\w+)", " ".join(troubles)))
    return ", ".join(f"{name} ({count})" for name, count in faults.items())


def release_loop(results: Path, name: str = "release_loop") -> str:
    """A release from several phases, one by one."""
    found = read(results / f"{name}.json")
    figures, facts = found["figures"], found["facts"]
    rows: list[tuple[object, ...]] = [
        (f"{t:g} t_c", *(row[name] for name in _NAMES))
        for t, row in zip(facts["phases_t_c"], figures["phases"], strict=True)
    ]
    spread = figures["over_phases"]
    rows.append(("**mean**", *(spread[name]["mean"] for name in _NAMES)))
    rows.append(("95 % confidence of the mean, +-", *(spread[name]["half_width_95"] for name in _NAMES)))
    rows.append(("least .. most", *(f"{spread[name]['least']:.4g} .. {spread[name]['most']:.4g}" for name in _NAMES)))
    before, under = (spread[f"Cd_net_{name}"]["mean"] for name in ("uncontrolled", "controlled"))
    return f"""Measured on {found["date"]}: {facts["bundle"]}, {facts["lead_in"]:g} t_c without and
{facts["controlled"]:g} with control, of which the last {facts["controlled"] - facts["settle"]:g} count. Mean `Cd_net`
is {before:.4f} without and {under:.4f} with control.

{table(_HEADS, rows)}"""


def tune(results: Path) -> str:
    """The winner of a search and the present settings."""
    found = read(results / "tune.json")
    figures, facts = found["figures"], found["facts"]
    given_up = sum(trial["given_up"] for trial in figures["trials"])
    scores = [trial["score"] for trial in figures["trials"] if trial["score"] is not None]
    return f"""Measured on {found["date"]}: {len(figures["trials"])} trials of {facts["phases"]} starts in
{figures["search_hours"]:.2f} h on a busy machine, {given_up} of them given up early, seed {facts["seed"]}. On the
coarse mesh the release scores {scores[0]:.2f} points, the best trial {max(scores):.2f}."""


def tune_settings(results: Path) -> str:
    """What was varied: present, winner's, and how much of the score's variance hangs on it."""
    found = read(results / "tune.json")
    figures = found["figures"]
    present, best = found["facts"]["present"], figures["best"] or {}
    rows = [
        (f"`{name}`", _value(present, name), _value(best, name), _share(figures["importances"], name))
        for name in found["facts"]["vary"]
    ]
    return table(("setting", "release", "best trial", "share in the variance of the score"), rows)


def _value(mpc: Mapping[str, Any], name: str) -> object:
    word = name.rpartition(".")[2]
    return mpc.get("weights", {}).get(word, mpc.get(word))


def _share(importances: Mapping[str, float], name: str) -> object:
    return f"{100 * importances[name]:.0f} %" if name in importances else None
