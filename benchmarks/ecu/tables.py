"""The tables of the ECU: sensor check, comparison of Python and C, proofs about the C code, and the loop with each
ECU."""

from itertools import groupby
from pathlib import Path
from typing import Any, Final

from benchmarks.common.markdown import read, table

_MODELLED: Final = ("modelled_ms", "modelled_ms_max")


def tables(results: Path) -> dict[str, str]:
    """Return the text of each table, by the table's name in the pages."""
    figures = read(results / "sensor_check.json")["figures"]
    return {
        "sensor_check_alarms": alarms(figures["false_alarms"]),
        "sensor_check_faults": faults(figures["faults"]),
        "ecu_c": twin(results / "ecu_c.json"),
        "proofs": proofs(read(results / "proofs.json")),
        "proofs_sabotage": sabotage(read(results / "proofs.json")),
        "models": models(read(results / "models.json")),
        "ecu_loop": loops(read(results / "ecu_loop.json")),
    }


def twin(path: Path) -> str:
    """Return the table of the comparison of the ECUs in C and in Python, and of the planted faults that it found."""
    found = read(path)
    of, facts = found["figures"], found["facts"]
    rows = [
        ("random control periods of both ECUs", of["steps"]),
        ("periods with a difference", of["mismatches"]),
        ("planted faults that the comparison finds", f"{of['planted_found']} of {of['planted']}"),
        ("executed branches", f"{of['branch_coverage_percent']} % of {of['branches']}"),
        ("mutants that no period detects", f"{of['survivors']} of {of['mutants']}"),
        ("undetected mutants without an explanation", len(of["survivors_unexplained"])),
        ("listed deviations from MISRA C:2012", f"{of['misra_deviations']} from {of['misra_rules']} rules"),
    ]
    return f"""{table(("", "figure"), rows)}

Measured on {found["date"]} for {len(facts["variants"])} configurations of the vehicle, with
{facts["compiler"]}."""


def proofs(found: Any) -> str:
    """Return two tables: the statements on the exported C that are proved by machine, with bound and assumption, and
    the statements that are not proved, with the reason."""
    of, facts = found["figures"], found["facts"]
    alike: dict[tuple[str, str, str], list[Any]] = {}
    for item in of["items"]:
        if item["state"] == "proved":
            part = item["part"] + (" (Eva)" if item["tool"] == "Eva" else "")
            alike.setdefault((part, item["bound"], item["assumes"]), []).append(item)
    rows = [
        (part, "; ".join(one["statement"] for one in items), bound or None, assumes or None,
         sum(one["conditions"] for one in items), round(sum(one["seconds"] for one in items), 1))
        for (part, bound, assumes), items in alike.items()
    ]  # fmt: skip
    undecided: dict[str, list[str]] = {}
    for item in of["items"]:
        if item["state"] != "proved":
            undecided.setdefault(item["open"] or item["why"], []).append(f"`{item['name']}`")
    heads = ("part", "proved for all inputs", "bound", "taken for granted", "conditions", "s")
    counts = ", ".join(f"{of[name]} {name}" for name in ("proved", "failed", "open"))
    return f"""{table(heads, rows)}

{of["properties"]} items: {counts}. Measured on {found["date"]} with ESBMC {facts["esbmc"]}, in CPU seconds.

{table(("not proved", "why"), [(", ".join(names), why) for why, names in undecided.items()])}"""


def sabotage(found: Any) -> str:
    """Return the table of the source lines that were changed on purpose, and of whether the proof that should fail did
    fail."""
    verdicts = {"failed": "found", "proved": "not found", "open": "open"}
    rows = [(one["what"], one["file"], one["item"], verdicts[one["state"]]) for one in found["figures"]["sabotaged"]]
    return table(("change", "source", "item", "result"), rows)


def models(found: Any) -> str:
    """Return the table of the explorations of all states of fail-safe and flashing."""
    of = found["figures"]
    fail_safe, flashing = of["fail_safe"], of["flashing"]
    rows = [
        ("states", fail_safe["states"], flashing["states"]),
        ("steps", fail_safe["steps"], flashing["transitions"]),
        ("cuts of the supply", None, flashing["cuts"]),
        ("cuts during a recovery", None, flashing["second_cuts"]),
        ("power-ons", None, flashing["boots"]),
        ("states from which operation continues", fail_safe["started"], flashing["recoveries"]),
        ("planted faults found", *(_found(of["sabotaged"], part) for part in ("fail_safe", "flashing"))),
    ]
    return f"""{table(("", "fail-safe", "flashing"), rows)}

All states were explored, on {found["date"]}."""


def _found(sabotaged: list[dict[str, str]], part: str) -> str:
    verdicts = [bool(one["found"]) for one in sabotaged if one["part"] == part]
    return f"{sum(verdicts)} of {len(verdicts)}"


def loops(found: Any) -> str:
    """Return the table of the wake under each ECU, and of differences between the emulated core and this machine."""
    rows = [
        (
            row["kind"],
            "none stated" if row["reduction_percent"] is None else f"{row['reduction_percent']:.2f} %",
            row["abs_Cl_controlled"],
            *(None if row["ecu"][name] is None else f"{row['ecu'][name]:.2f}" for name in _MODELLED),
            f"{row['largest_command_difference']:.2g}",
        )
        for row in found["figures"]
    ]
    core = next(row for row in found["figures"] if row["kind"] == "mcu")
    heads = ("ECU", "less drag", "mean abs Cl", "modelled ms, median", "largest", "largest difference to C's command")
    frames = f"{core['differing_frames']} of {core['frames_compared']} frames"
    states = f"{core['differing_states']} of {core['steps_compared']} states"
    return f"""{table(heads, rows)}

Measured on {found["date"]}. On the emulated core {frames} and {states} differ from those of this machine with
equal contraction."""


def alarms(rows: list[dict[str, Any]]) -> str:
    """Return the table of false alarms in the whole recording, for each disturbance of the healthy sensors."""
    words = {"none": "nothing", "noise 0.9": "noise of 90 %", "lost 0.3": "loss of 30 % of the frames"}
    found = [
        (
            words[row["through"]],
            round(row["hours"], 3),
            row["alarms"],
            f"below {row['below_per_hour']:.3g}" if row["alarms"] == 0 else f"{row['per_hour']:.3g}",
        )
        for row in rows
        if row["role"] == "all"
    ]
    return table(("disturbance", "hours", "false alarms", "per hour"), found)


def faults(rows: list[dict[str, Any]]) -> str:
    """Return the table of the outcomes of each kind of fault, over all sensors or pairs of sensors."""
    counts = ("starts", "set_aside", "shut", "wrong", "unseen")
    found = []
    for fault, group in groupby(rows, key=lambda row: row["fault"]):
        of = list(group)
        medians = [row["periods_median"] for row in of]
        least, most = f"{min(medians):g}", f"{max(medians):g}"
        median = least if least == most else f"{least} to {most}"
        found.append(
            (fault, *(sum(row[name] for row in of) for name in counts), median, max(row["periods_max"] for row in of))
        )
    heads = ("fault", "cases", "set aside", "shut", "healthy", "unseen", "median of periods", "most periods")
    return table(heads, found)
