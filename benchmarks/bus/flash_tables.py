"""The tables of flashing: the effects of interruptions of the power supply, and the duration of a transfer."""

from pathlib import Path
from typing import Any, Final

from benchmarks.common.markdown import read, table

_LOST: Final = {
    "bricked": "power-ons after which no release ran",
    "wrong_release": "power-ons after which a release ran that may not run",
    "confirmed_lost": "confirmed images that were lost or changed",
    "counter_moved": "security versions that rose before a confirmation",
    "checkpoint_lost": "acknowledged bytes that were requested again",
    "reflash_failed": "cases in which no new release could be flashed and confirmed",
}

_LONG_MS: Final = 3.0
"""Smallest modelled time in ms for which a piece of work for flashing is listed in the table. With a shorter piece, the
control step still ends long before the end of its period."""


def tables(results: Path) -> dict[str, str]:
    """Return the text of each table, by the table's name in the pages."""
    found = read(results / "flash.json")
    return {
        "flash_proof": proof(found),
        "flash_c": in_c(read(results / "flash_c.json")),
        "uds_states": in_states(read(results / "uds_states.json")),
        "flash_pieces": pieces(read(results / "flash_pieces.json")),
        "flash_times": times(read(results / "flash_times.json")),
    }


def proof(found: dict[str, Any]) -> str:
    """Return the table of a test with interruptions of the power supply: counts of its steps and of the losses. The
    ECU's store is a folder."""
    of, facts = found["figures"], found["facts"]
    texts = {
        "operations": "calls in the whole sequence that change the store",
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


def in_c(found: dict[str, Any]) -> str:
    """Return the table of the loader in C: counts of its test with interruptions of the power supply, and its
    memory."""
    of = found["figures"]
    texts = {
        "cuts_depth_1": "first cuts of the supply",
        "cuts_depth_2": "second cuts, in the recovery from a first one",
        "bricked": "recoveries after which no release ran",
        "confirmed_lost": "confirmed images that were lost or changed",
        "images": "altered images checked in both languages",
        "calls": "random calls of the store in both languages",
        "calls_compared": "compared control periods and calls of diagnosis",
        "mismatches": "differences",
        "fuzz_requests": "hostile requests under sanitisers, without an error",
        "loader_flash_kib": "flash, KiB (-Os, Cortex-M7)",
        "loader_ram_kib": "RAM of the loader without the stack, KiB",
        "stack_b": "stack of the deepest chain of calls, without drivers, bytes",
    }
    rows = [(text, of[name]) for name, text in texts.items()]
    if "branches" in of:
        taken = f"{of['branches_taken']} of {of['branches']}; {of['branches_explained']} cannot be reached"
        rows.append(("executed branches of the store", taken))
    cut = f"The supply was cut in {found['facts']['eighths']} of 8 operations of the flash memory."
    return f"{table(('', 'figure'), rows)}\n\n{cut}"


def in_states(found: dict[str, Any]) -> str:
    """Return the table of the test that sends requests to the ECUs in Python and in C in all states of diagnosis."""
    of = found["figures"]
    texts = {
        "requests": "requests to both ECUs",
        "states": "states of diagnosis in which requests arrived",
        "services_in_states": "pairs of a state and a service",
        "kinds_of_answers": "kinds of answers",
        "mismatches": "differences",
    }
    rows = [(text, of[name]) for name, text in texts.items()]
    return f"{table(('', 'figure'), rows)}\n\nMeasured on {found['date']} in {of['builds']} builds."


def pieces(found: dict[str, Any]) -> str:
    """Return the table of the computing time that diagnosis takes from control on the emulated board."""
    of, facts = found["figures"], found["facts"]
    clocks = next(iter(of.values()))
    rows = [(what, *(f"{ms:.2f}" for ms in at.values())) for what, at in of.items() if max(at.values()) > _LONG_MS]
    release = f"{facts['bundle']} ({facts['digest'][:12]})"
    return f"""{table(("longest time, modelled, ms", *clocks), rows)}

Measured on {found["date"]}: {release}, control periods of {facts["period_ms"]:g} ms."""


def times(found: dict[str, Any]) -> str:
    """Return the table of the durations of a transfer of the shipped release over the simulated bus."""
    of = found["figures"]
    rows = [
        (
            "CAN FD, 500 kbit/s and 2 Mbit/s" if row["frames"] == "fd" else "classic CAN, 500 kbit/s",
            f"{100 * row['lost']:g} %",
            f"{row['seconds']:.1f}",
            row["diagnostic_frames"],
            f"{100 * row['load']:.0f} %",
            row["unanswered"],
        )
        for row in of["flash_times"]
    ]
    heads = ("bus", "lost frames in each direction", "seconds", "frames of diagnosis", "bus load", "repeated requests")
    return f"""{table(heads, rows)}

An image of {of["flash_times"][0]["bytes"]} bytes is sent. Times are virtual, from the first request to the
confirmation, a restart of the ECU (0.3 s) included. The ECU sends its usual frames, but does not control. Measured on
{found["date"]} with commit {found["facts"]["commit"]}, which has the bench."""
