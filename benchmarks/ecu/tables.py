"""The tables of the ECU: sensor check, comparison of Python and C, proofs, flashing, and the loop with each ECU."""

import tomllib
from itertools import groupby
from typing import Any, Final

from benchmarks.common.command_line import ROOT
from benchmarks.common.documents import table

_MODELLED: Final = ("modelled_ms", "modelled_ms_max")
_LOST: Final = {
    "bricked": "power-ons after which no release ran",
    "wrong_release": "power-ons after which a forbidden release ran",
    "confirmed_lost": "confirmed images lost or changed",
    "counter_moved": "security versions raised before a confirmation",
    "checkpoint_lost": "acknowledged bytes requested again",
    "reflash_failed": "cases in which no release could be flashed and confirmed",
}
_LONG_MS: Final = 3.0
"""Smallest modelled time in ms of a piece of flashing work that the table lists."""
_ITEMS: Final = ROOT / "tests" / "proofs" / "prove" / "items.toml"


def twin(found: Any) -> str:
    """Return the table of the comparison of the ECUs in C and in Python, and of the planted faults that it found."""
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
    """Return tables of what is proved on each part of the exported C, and of what is not proved, with the reasons."""
    of, facts = found["figures"], found["facts"]
    parts: dict[str, list[Any]] = {}
    undecided: dict[str, list[str]] = {}
    for item in of["items"]:
        parts.setdefault(item["part"], []).append(item)
        if item["state"] != "proved":
            undecided.setdefault(item["open"] or item["why"].partition(": ERROR")[0], []).append(f"`{item['name']}`")
    rows = []
    planned = {item["name"]: item for item in tomllib.loads(_ITEMS.read_text(encoding="utf-8"))["item"]}
    for part, items in parts.items():
        proved = [planned[item["name"]] for item in items if item["state"] == "proved"]
        texts = ("; ".join(one[name] for one in proved if name in one) or None for name in ("short", "short_bound"))
        eva = " (Eva)" if items[0]["tool"] == "Eva" else ""
        rows.append((part + eva, f"{len(proved)}/{len(items)}", *texts))
    counts = ", ".join(f"{of[name]} {name}" for name in ("proved", "failed", "open"))
    conditions = sum(item["conditions"] for item in of["items"] if item["state"] == "proved")
    missed = [f"`{one['item']}`" for one in of["sabotaged"] if one["state"] != "failed"]
    return f"""{table(("part", "items", "proved for all inputs", "bound or assumption"), rows)}

{of["properties"]} items: {counts}; {conditions} proved conditions; {of["seconds"] / 60:.0f} minutes of one core.
Measured on {found["date"]} with ESBMC {facts["esbmc"]}.

{table(("not proved", "why"), [(", ".join(names), why) for why, names in undecided.items()])}

Planted defects found: {of["sabotage_found"]} of {of["sabotage"]}; not found: in {", ".join(missed) or "none"}."""


def models(found: Any) -> str:
    """Return the table of the model checks that explore all states of fail-safe and flashing."""
    of = found["figures"]
    fail_safe, flashing = of["fail_safe"], of["flashing"]
    planted = ([one["found"] for one in of["sabotaged"] if one["part"] == part] for part in ("fail_safe", "flashing"))
    rows = [
        ("states", fail_safe["states"], flashing["states"]),
        ("steps", fail_safe["steps"], flashing["transitions"]),
        ("cuts of the supply", None, flashing["cuts"]),
        ("cuts during a recovery", None, flashing["second_cuts"]),
        ("power-ons", None, flashing["boots"]),
        ("checks that control can start, a release can be flashed", fail_safe["started"], flashing["recoveries"]),
        ("planted faults found", *(f"{sum(map(bool, each))} of {len(each)}" for each in planted)),
    ]
    return f"""{table(("", "fail-safe", "flashing"), rows)}

All states were explored on {found["date"]}."""


def loops(found: Any) -> str:
    """Return the table of the wake under each ECU, and of differences between the emulated core and the PC."""
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

Measured on {found["date"]}. The ECU on the emulated core and the same C code on the PC, compiled with the same fused
operations, differ in {frames} and {states}."""


def alarms(found: Any) -> str:
    """Return the table of false alarms in the whole recording, for each disturbance of the healthy sensors."""
    words = {"none": "nothing", "noise 0.9": "noise of 90 %", "lost 0.3": "loss of 30 % of the frames"}
    rows = []
    for row in found["figures"]["false_alarms"]:
        if row["role"] == "all":
            rate = f"{row['per_hour']:.3g}" if row["alarms"] else f"below {row['below_per_hour']:.3g}"
            rows.append((words[row["through"]], round(row["hours"], 3), row["alarms"], rate))
    return table(("disturbance", "hours", "false alarms", "per hour"), rows)


def faults(found: Any) -> str:
    """Return the table that counts the outcomes of each kind of fault over all sensors or pairs."""
    counts = ("starts", "set_aside", "shut", "wrong", "unseen")
    rows = []
    for fault, group in groupby(found["figures"]["faults"], key=lambda row: row["fault"]):
        of = list(group)
        medians = [row["periods_median"] for row in of]
        least, most = f"{min(medians):g}", f"{max(medians):g}"
        median = least if least == most else f"{least} to {most}"
        sums = (sum(row[name] for row in of) for name in counts)
        rows.append((fault, *sums, median, max(row["periods_max"] for row in of)))
    heads = ("fault", "cases", "set aside", "shut", "healthy", "unseen", "median of periods", "most periods")
    return table(heads, rows)


def flash_proof(found: Any) -> str:
    """Return the table of the power cuts of an ECU whose store is a folder, with the number of losses."""
    of, facts = found["figures"], found["facts"]
    texts = {
        "operations": "calls that change the store",
        "cuts_depth_1": "first cuts of the supply",
        "cuts_depth_2": "second cuts, in the recovery from a first one",
        "boots": "checked power-ons",
        **_LOST,
    }
    rows = [(text, of[name]) for name, text in texts.items()]
    which = "each of the calls" if facts["every"] == 1 else f"one in {facts['every']} of the calls"
    return f"""{table(("", "figure"), rows)}

Measured on {found["date"]} with {facts["versions"]["stillwake"]}; the supply is cut in {which} in {facts["seeds"]}
ways. The second cuts are random."""


def flash_c(found: Any) -> str:
    """Return the table of the loader in C: its memory, and the numbers of its tests, including power cuts."""
    of = found["figures"]
    texts = {
        "cuts_depth_1": "first cuts of the supply",
        "cuts_depth_2": "second cuts, in the recovery from a first one",
        "bricked": "recoveries after which no release ran",
        "confirmed_lost": "confirmed images lost or changed",
        "images": "altered images checked in both languages",
        "calls": "random calls of the store in both languages",
        "calls_compared": "compared control periods and calls of diagnosis",
        "mismatches": "differences",
        "fuzz_requests": "hostile requests without a sanitiser's error",
        "loader_flash_kib": "flash, KiB (-Os, Cortex-M7)",
        "loader_ram_kib": "RAM of the loader without the stack, KiB",
        "stack_b": "stack of the deepest chain of calls, without drivers, bytes",
    }
    rows = [(text, of[name]) for name, text in texts.items()]
    if "branches" in of:
        taken = f"{of['branches_taken']} of {of['branches']}; {of['branches_explained']} cannot be reached"
        rows.append(("executed branches of the store", taken))
    eighths = found["facts"]["eighths"]
    if eighths < 8:
        rows.append(("share of the flash memory's operations in which the supply was cut", f"{eighths} of 8"))
    return table(("", "figure"), rows)


def uds_states(found: Any) -> str:
    """Return the figures of a test that sends requests to the ECUs in Python and C in all states of diagnosis."""
    of = found["figures"]
    where = f"{of['states']} states of diagnosis ({of['services_in_states']} pairs of a state and a service)"
    answers = f"{of['kinds_of_answers']} kinds of answers and {of['mismatches']} differences"
    measured = f"Measured on {found['date']} in {of['builds']} builds."
    return f"{of['requests']} requests to both ECUs, in {where}, gave {answers}. {measured}"


def flash_pieces(found: Any) -> str:
    """Return the table of the computing time that diagnosis takes from control on the emulated board."""
    of, facts = found["figures"], found["facts"]
    clocks = next(iter(of.values()))
    rows = [(what, *(f"{ms:.2f}" for ms in at.values())) for what, at in of.items() if max(at.values()) > _LONG_MS]
    release = f"{facts['bundle']} ({facts['digest'][:12]})"
    return f"""{table(("longest modelled time, ms", *clocks), rows)}

Measured on {found["date"]}: {release}, control periods of {facts["period_ms"]:g} ms."""
