"""The tables of the shipped release from several phases, and of what a search found."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from benchmarks.common.markdown import read, table
from firmware_sim.tuning.space import is_weight

_HEADS = ("", "less drag, %", "mean abs Cl", "mean Cl", "rms action", "jet power", "less Cd_net, %", "less power, %")
_NAMES = (
    *("reduction_percent", "abs_Cl_controlled", "mean_Cl_controlled", "rms_action", "jet_power_controlled"),
    *("net_reduction_percent", "net_of_power_percent"),
)


def tables(results: Path) -> dict[str, str]:
    """Every table by its marker."""
    return {"release_loop": release_loop(results), "tune": tune(results), "tune_settings": tune_settings(results)}


def release_loop(results: Path) -> str:
    """The shipped release from several phases, one by one."""
    found = read(results / "release_loop.json")
    figures, facts = found["figures"], found["facts"]
    rows: list[tuple[object, ...]] = [
        (f"{t:g} t_c", *(row[name] for name in _NAMES))
        for t, row in zip(facts["phases_t_c"], figures["phases"], strict=True)
    ]
    spread = figures["over_phases"]
    rows.append(("**mean**", *(spread[name]["mean"] for name in _NAMES)))
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
    text = f"""Measured on {found["date"]}: {len(figures["trials"])} trials of {facts["phases"]} starts in
{figures["search_hours"]:.2f} h on a busy machine, {given_up} of them given up early, seed {facts["seed"]}. On the
coarse mesh the release scores {scores[0]:.2f} points, the best trial {max(scores):.2f}."""
    if not figures["judged"]:
        return text
    heads = ("", "less drag, %", "least .. most", "mean abs Cl", "largest", "less Cd_net, %", "rms action", "jet power")
    return f"""{text} Judged from {len(figures["judged"][0]["runs"])} starts: {figures["verdict"]}.

{table(heads, [_judged(one) for one in figures["judged"]])}"""


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


def _judged(one: Mapping[str, Any]) -> tuple[object, ...]:
    runs = one["runs"]
    drag, lift = [run["reduction_percent"] for run in runs], [run["abs_Cl"] for run in runs]
    if None in drag or None in lift:
        return (one["name"], *[None] * 7)
    others = (_mean(runs, name) for name in ("Cd_net_reduction_percent", "rms_action", "jet_power"))
    return (
        one["name"],
        sum(drag) / len(drag),
        f"{min(drag):.4g} .. {max(drag):.4g}",
        sum(lift) / len(lift),
        max(lift),
        *others,
    )


def _mean(runs: Sequence[Mapping[str, float]], name: str) -> float:
    return sum(run[name] for run in runs) / len(runs)


def _value(mpc: Mapping[str, Any], name: str) -> object:
    word = name.rpartition(".")[2]
    return mpc.get("weights", {}).get(word) if is_weight(name) else mpc.get(word)


def _share(importances: Mapping[str, float], name: str) -> object:
    return f"{100 * importances[name]:.0f} %" if name in importances else None
