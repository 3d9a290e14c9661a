"""The tables of the ECU: its sensor check, its twin in C, the loop with each."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

from benchmarks.common.markdown import read, table
from can_bridge.wire.messages import Reason

_WATCHED: Final = (
    *("undisturbed", "noise_0.9", "delay_12", "delay_2_uncompensated", "delay_4_uncompensated"),
    *("delay_8_uncompensated", "delay_12_uncompensated", "dead_upper_39", "dead_base_0", "drift", "swapped"),
    *("frames_lost_0.2", "frames_late", "reynolds_300", "reynolds_700", "reynolds_1000", "gust"),
    *("wrong_operating_point", "wrong_body", "action_limit_halved", "jets_stuck"),
)
"""Scenarios of the campaign in which control may not help, and useful ones beside them."""
_MODELLED: Final = ("modelled_ms", "modelled_ms_max")


def tables(results: Path) -> dict[str, str]:
    """Every table by its marker."""
    figures = read(results / "sensor_check.json")["figures"]
    return {
        "sensor_check_alarms": alarms(figures["false_alarms"]),
        "sensor_check_faults": faults(figures["faults"]),
        "ecu_c": twin(results / "ecu_c.json"),
        "ecu_loop": loops(read(results / "ecu_loop.json")),
        "monitor": monitor(results / "campaign.json"),
    }


def monitor(path: Path) -> str:
    """What the campaign's scenarios come to in which control may not help, and useful ones beside them."""
    found = read(path)
    controlled = found["facts"]["controlled"]
    rows = [
        (
            row["name"],
            f"{row['reduction_percent']:.1f}",
            f"{row['abs_Cl']:.2f}",
            f"{row['abs_Cl_uncontrolled']:.2f}",
            *_shut(row, controlled),
        )
        for row in found["figures"]
        if row["name"] in _WATCHED
    ]
    heads = ("scenario", "less drag, %", "mean abs Cl", "without control", "in control, t_c", "shut by")
    return table(heads, rows)


def _shut(row: Mapping[str, Any], controlled: float) -> tuple[str | None, str | None]:
    """How long a scenario was in control, and why no longer, if a fault latched or control was tested."""
    reasons = row["not_in_control_reasons"]
    if not (row["latches"] or Reason.NOT_HELPING.name in reasons):
        return None, None
    return f"{row['in_control_percent'] / 100.0 * controlled:.0f}", max(reasons, key=reasons.get)


def twin(path: Path) -> str:
    """The comparison of the ECU in C with its twin, and how sharp it is."""
    found = read(path)
    of, facts = found["figures"], found["facts"]
    rows = [
        ("random control periods through both", of["steps"]),
        ("of them with a difference", of["mismatches"]),
        ("planted faults that are found", f"{of['planted_found']} of {of['planted']}"),
        ("branches that are taken", f"{of['branch_coverage_percent']} % of {of['branches']}"),
        ("mutants that no period notices", f"{of['survivors']} of {of['mutants']}"),
        ("of them without an explanation", len(of["survivors_unexplained"])),
        ("deviations from MISRA C:2012, all listed", f"{of['misra_deviations']} of {of['misra_rules']} rules"),
    ]
    return f"""{table(("", "figure"), rows)}

Measured on {found["date"]} in {len(facts["variants"])} kinds of vehicles, with
{facts["compiler"]}."""


def loops(found: Any) -> str:
    """The wake driven by each ECU, and what differs between the emulated core and this machine."""
    rows = [
        (
            row["kind"],
            "none claimed" if row["reduction_percent"] is None else f"{row['reduction_percent']:.2f} %",
            row["abs_Cl_controlled"],
            f"{row['periods_in_control']} of {row['periods_requested']}",
            *(None if row["ecu"][name] is None else f"{row['ecu'][name]:.2f}" for name in _MODELLED),
            f"{row['largest_command_difference']:.2g}",
        )
        for row in found["figures"]
    ]
    core = next(row for row in found["figures"] if row["kind"] == "mcu")
    times = ("modelled ms, median", "most")
    heads = (
        "ECU",
        "less drag",
        "mean abs Cl",
        "periods in control",
        *times,
        "largest difference of a command from C's",
    )
    frames = f"{core['differing_frames']} of {core['frames_compared']} frames"
    states = f"{core['differing_states']} of {core['steps_compared']} states"
    return f"""{table(heads, rows)}

Measured on {found["date"]}. The emulated core against this machine, with the same contraction:
{frames} and {states} differ."""


def alarms(rows: list[dict[str, Any]]) -> str:
    """False alarms by what disturbed the sound sensors, and by role."""
    words = {"none": "nothing", "noise 0.9": "noise of 90 %", "lost 0.3": "30 % of the frames lost"}
    found = [
        (
            words[row["through"]],
            row["role"],
            round(row["hours"], 3),
            row["alarms"],
            f"below {row['below_per_hour']:.3g}" if row["alarms"] == 0 else f"{row['per_hour']:.3g}",
        )
        for row in rows
    ]
    return table(("disturbed by", "episodes", "hours", "false alarms", "an hour"), found)


def faults(rows: list[dict[str, Any]]) -> str:
    """What is found of each fault."""
    found = [
        (
            row["fault"],
            row["sensor"],
            row["starts"],
            row["set_aside"],
            row["shut"],
            row["wrong"],
            row["unseen"],
            row["periods_median"],
            row["periods_max"],
        )
        for row in rows
    ]
    heads = ("fault", "sensors", "starts", "set aside", "shut", "another one", "unseen", "periods, median", "at most")
    return table(heads, found)
