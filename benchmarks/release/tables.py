"""The tables of the release in the closed loop: its starts, other speeds, the campaign, other plants, other methods."""

import re
from collections import Counter
from collections.abc import Mapping
from textwrap import fill
from typing import Any, Final

from benchmarks.common.documents import table


def iterations(found: Any) -> str:
    """Return the table that states how the iterations change the cost in each case."""
    facts, rows = found["facts"], []
    for name, change in found["figures"]["change_percent"].items():
        interval = f"{change['lower']:.2f} .. {change['upper']:.2f}" if facts["pairs"][name] else "no iterations"
        rows.append((name, facts["pairs"][name], f"{change['mean']:.2f}", interval))
    return f"""{table(("case", "pairs of runs", "change of the cost by the iterations, %", "95 % interval"), rows)}

Measured on {found["date"]} with {facts["bundle"]}, default mesh, int8, through CAN."""


def release_forecasts(found: Any) -> str:
    """Return the table of the errors of the controller's forecasts in the closed loop."""
    figures = found["figures"]
    sigma = figures["sigma"]["uncontrolled"]
    rows = []
    for row in figures["forecast"]:
        if row["h"] == 1 or row["h"] % 5 == 0:
            drag, lift = ((one["mean"], f"{one['p10']:.4f}..{one['p90']:.4f}") for one in (row["drag"], row["lift"]))
            rows.append((row["h"], *drag, *lift))
    heads = ("h", "mean error of Cd", "10 to 90 %", "mean error of Cl", "10 to 90 %")
    return f"""{table(heads, rows)}

Measured on {found["date"]} with {found["facts"]["bundle"]["name"]}, over the last
{found["facts"]["controlled"] - found["facts"]["settle"]:g} t_c. Without control, Cd and Cl have standard deviations
of {sigma["drag"]:.3f} and {sigma["lift"]:.3f}."""


def release_distributions(found: Any) -> str:
    """Return the table of base pressure, velocity at the probe and bubble length, with the paper's values."""
    figures = found["figures"]
    base, probe = ([figures[name][case] for case in ("uncontrolled", "controlled")] for name in ("base_Cp", "Uy"))
    rows = [
        ("base Cp, mean", *(one["mean"] for one in base), -0.441, -0.283),
        ("base Cp, standard deviation", *(one["std"] for one in base), None, None),
        ("Uy at (10, 0), standard deviation", *(one["std"] for one in probe), 0.516, 0.396),
        ("recirculation bubble, W", *(one["recirculation_length"] for one in figures["mean"]), None, None),
    ]
    return table(("", "uncontrolled", "controlled", "paper, uncontrolled", "paper, controlled"), rows)


def bundle_fuzz(found: Any) -> str:
    """Return the table of damaged bundles, graphs and C headers, and of how many of them were accepted."""
    figures = found["figures"]
    rows = [
        (kind, row["cases"], row["accepted"], sum(row["refused"].values()), f"{1e3 * row['slowest_s']:.0f}")
        for kind, row in figures["kinds"].items()
    ]
    heads = ("damaged", "cases", "accepted", "refused with a reason", "slowest, ms")
    return f"""{table(heads, rows)}

Measured on {found["date"]}: {figures["cases"]} cases with seed {found["facts"]["seed"]}, at most
{figures["max_rss_mb"]:.0f} MB of memory, {figures["max_rss_before_mb"]:.0f} MB before the first case. An accepted
image, folder or manifest with damaged bytes has the original content, because the damaged bytes are not read. The other
accepted cases are valid unsigned bundles with another content.
"""


def summary(demo: Any, openfoam: Any, sines: Any, phases: Any, roads: Any, drives: Any) -> str:
    """Return the table of the uncontrolled wake, the best sinusoidal forcing, and the closed loop on both plants."""
    loop, second, spread = demo["figures"], openfoam["figures"], phases["figures"]["over_phases"]
    sine = min((row for row in sines["figures"] if row["frequency"] > 0), key=lambda row: float(row["Cd"]))
    linear = next(row for row in roads["figures"] if row["road"] == "linear-under-release")
    averaged = ("abs_Cl_controlled", "Cd_net_controlled", "rms_action", "jet_power_controlled")
    drag, starts = spread["reduction_percent"], len(phases["figures"]["phases"])
    rows: list[tuple[object, ...]] = [
        ("uncontrolled", *(loop[f"{name}_uncontrolled"] for name in _MEANS), 0.0, 0.0, ""),
        (
            f"best sine without feedback (frequency {sine['frequency']:.2f})",
            *(sine[name] for name in (*_MEANS, "rms_action", "jet_power")),
            f"{100 * (1 - sine['Cd'] / loop['Cd_uncontrolled']):.1f} %",
        ),
        ("closed loop over CAN, 4 sensors, int8 (one start)", *_under(loop), f"**{loop['reduction_percent']:.1f} %**"),
        (
            f"{phases['facts']['bundle']}, mean of {starts} starts with 95 % confidence interval",
            *(spread["Cd_controlled"]["mean"], None, *(spread[name]["mean"] for name in averaged)),
            f"{drag['mean']:.1f} +- {drag['half_width_95']:.1f} % ({drag['least']:.1f} .. {drag['most']:.1f})",
        ),
        (
            f"{openfoam['facts']['controller'].partition(' ')[0]} on OpenFOAM's icoFoam "
            f"(uncontrolled: {second['Cd_uncontrolled']:.3f}, one start)",
            *_under(second),
            f"{second['reduction_percent']:.1f} %",
        ),
        (
            f"linear controller (of version 1.0.0), mean of {len(linear['outcomes'])} starts",
            *(linear["Cd"], None, *(linear[name] for name in ("abs_Cl", "Cd_net", "rms_action", "jet_power"))),
            f"{linear['reduction_percent']:.1f} % ({linear['least_reduction_percent']:.1f} .. "
            f"{linear['most_reduction_percent']:.1f})",
        ),
    ]
    steady = (row for row in drives["figures"] if row["speed_percent"] and not row["disturbed"])
    served = ", ".join(
        f"{row['reduction_percent']:.0f} % ({row['reduction_least']:.0f} to {row['reduction_most']:.0f}) at {speed} %"
        for row in steady
        if (speed := row["speed_percent"]) % 20 == 0 or speed == 130
    )
    at_speeds = (
        f"[At other speeds](docs/explanation/other-speeds.md) {drives['facts']['bundle']} reduces drag on a coarse "
        f"mesh (medians and ranges of three starts) by {served} of the design speed."
    )
    heads = ("", "wall Cd", "base Cp", "mean abs Cl", "Cd with slots and jets", "rms action", "jet power", "less drag")
    latency = f"{loop['mpc_ms_p50']:.1f} ms (p99 {loop['mpc_ms_p99']:.1f}, max {loop['mpc_ms_max']:.1f})"
    return f"""{table(heads, rows)}

Mean Cl under control is {loop["mean_Cl_controlled"]:+.3f}. A control step takes {latency} of the
{loop["mpc_budget_ms"]:g} ms budget. Of {loop["frames_sent"]} frames {loop["frames_lost"]} were lost and
{loop["frames_rejected"]} rejected.

{fill(at_speeds, 120, break_long_words=False)}
"""


_MEANS: Final = ("Cd", "base_Cp", "abs_Cl", "Cd_net")


def _under(loop: Mapping[str, Any]) -> tuple[float, ...]:
    return (*(loop[f"{name}_controlled"] for name in _MEANS), loop["rms_action"], loop["jet_power_controlled"])


def demo(found: Any) -> str:
    """Return the table of the loop of `make demo`, without and with control."""
    figures, facts = found["figures"], found["facts"]
    latency = "/".join(f"{figures[name]:.2f}" for name in ("mpc_ms_p50", "mpc_ms_p99", "mpc_ms_max"))
    rows = [
        ("mean Cd (wall)", figures["Cd_uncontrolled"], figures["Cd_controlled"]),
        ("mean base Cp", figures["base_Cp_uncontrolled"], figures["base_Cp_controlled"]),
        ("mean abs Cl", figures["abs_Cl_uncontrolled"], figures["abs_Cl_controlled"]),
        ("mean Cl", None, figures["mean_Cl_controlled"]),
        ("rms action", 0.0, figures["rms_action"]),
        ("mean Cd, wall + slots + jet momentum", figures["Cd_net_uncontrolled"], figures["Cd_net_controlled"]),
        ("mean jet power / (rho U_inf^3 W / 2)", 0.0, figures["jet_power_controlled"]),
    ]
    return f"""Measured on {found["date"]}: {figures["controller"]}, sensors {", ".join(figures["sensors"])},
{facts["config"]["ecu"]["compute_time_ms"]:g} ms of virtual time for a control step. Control reduces wall drag by
**{figures["reduction_percent"]:.1f} %**.

{table(("", "uncontrolled", "controlled"), rows)}

A control step takes {latency} ms (p50/p99/max) of {figures["mpc_budget_ms"]:g} ms. Of
{figures["frames_sent"]} frames {figures["frames_lost"]} were lost and {figures["frames_rejected"]} rejected."""


def limits(*loops: Any) -> str:
    """Return the table of drag and lift by computing time, planning ahead and the number of iterations."""
    names = ("Cd_controlled", "reduction_percent", "abs_Cl_controlled", "mean_Cl_controlled", "rms_action")
    facts = loops[0]["facts"]
    late, period = facts["config"]["ecu"]["compute_time_ms"], facts["budget_ms"]
    labels = (
        "the release: plans a period ahead",
        f"no planning ahead, {late:g} ms for computing",
        "no planning ahead, no time for computing",
        "version 0.2.0: no planning ahead, 15 iterations",
    )
    rows = [(label, *(loop["figures"][key] for key in names)) for label, loop in zip(labels, loops, strict=True)]
    return f"""{table(("", "mean Cd (wall)", "less drag, %", "mean abs Cl", "mean Cl", "rms action"), rows)}

The first three rows differ in the time from the sample to the jets' response: a period of {period:g} ms, for which the
controller plans; {late:g} ms, which the controller's model does not contain; or none."""


def steady(found: Any, demo: Any) -> str:
    """Return the table that compares the symmetric and the shedding wake, and the bound on the reduction."""
    held, shedding = found["figures"], demo["figures"]
    rows = [
        ("shedding", shedding["Cd_uncontrolled"], shedding["Cd_net_uncontrolled"], shedding["base_Cp_uncontrolled"]),
        ("steady, symmetric", held["Cd"], held["Cd"] + held["Cd_slot"], held["base_Cp"]),
    ]
    bound = 100.0 * (1.0 - held["Cd"] / shedding["Cd_uncontrolled"])
    return f"""Measured on {found["date"]}, from rest until the flow is steady ({held["time"]:.0f} t_c, max |du/dt|
{held["velocity_rate"]:.0e}). Its recirculation bubble is {held["recirculation_length"]:.2f} W long.

{table(("", "Cd (wall)", "Cd with slots", "mean base Cp"), rows)}

Complete suppression of shedding would save **{bound:.1f} %** of the wall drag; a larger reduction needs a change
of the mean flow by the jets."""


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
    heads = ("drive", "less drag, % (range of starts)", "less net energy, %", "mean abs Cl", "without control")
    return f"""{table((*heads, "in control, % (latched fault, starts)"), rows)}

Measured on {found["date"]}: {facts["bundle"]} ({facts["digest"][:12]}), refinement {facts["mesh"]:g}, medians of
{facts["phases"]} starts in one shedding cycle: {facts["lead_in"]:g} t_c at the design speed without control, then the
drive. Averages leave out the drive's first {facts["settle"]:g} t_c."""


def _latched(troubles: list[str]) -> str:
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
    """Return the table of the campaign, with a row for each scenario."""
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
    """Return the percentage of periods in control, and latched faults in brackets; "" for 100 % without such faults."""
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
        rows.append((facts["plant"], *(figures.get(name) for name in columns)))
        notes.append(
            f"- {facts['plant']}: {figures['controller']}, {found['date']};\n"
            f"  means of {figures['cycles_controlled']} shedding cycles, {facts['settle']:g} t_c after the request; "
            f"{figures['frames_lost']} of {figures['frames_sent']} frames lost."
        )
    return "\n".join([table(("closed loop", *columns.values()), rows), "", *notes])


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
