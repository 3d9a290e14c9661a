"""The tables of flashing: what cut supplies and hostile requests did, and what a transfer takes."""

from pathlib import Path
from typing import Any, Final

from benchmarks.common.markdown import read, table

_LOST: Final = {
    "bricked": "power-ons after which no release ran",
    "wrong_release": "power-ons after which another release ran than may",
    "confirmed_lost": "confirmed images that were lost or changed",
    "counter_moved": "security versions that moved before a confirmation",
    "checkpoint_lost": "acknowledged bytes that were wanted again",
    "reflash_failed": "cases in which flashing again did not end confirmed",
}


def tables(results: Path) -> dict[str, str]:
    """Every table by its marker."""
    found = read(results / "flash.json")
    return {"flash_proof": proof(found), "flash_fuzz": fuzz(found["figures"]), "flash_times": times(found["figures"])}


def proof(found: dict[str, Any]) -> str:
    """Cuts, and what was lost."""
    of, facts = found["figures"], found["facts"]
    rows = [
        ("writes and erasures of the whole sequence, flash memory", of["operations"]),
        ("changing calls of the whole sequence, folder", of["calls_folder"]),
        ("first cuts, flash memory", of["cuts_depth_1"]),
        ("second cuts, in the recovery from a first one", of["cuts_depth_2"]),
        ("first cuts, folder", of["cuts_folder"]),
        ("second cuts, folder", of["cuts_folder_depth_2"]),
        ("ECUs with both slots spoilt", of["both_slots_spoilt"]),
        ("power-ons that were judged", of["boots"]),
        *((text, of[kind]) for kind, text in _LOST.items()),
    ]
    which = "each of them" if facts["every"] == 1 else f"one in {facts['every']} of them"
    return f"""{table(("", "figure"), rows)}

Measured on {found["date"]}: {which} is cut, in the flash memory in {_ways(facts["seeds"])}, in the folder in
{_ways(facts["folder_seeds"])}. The second cuts are drawn by the seed."""


def fuzz(of: dict[str, Any]) -> str:
    """Hostile requests."""
    rows = [
        ("requests", of["fuzz_requests"]),
        ("exceptions that left the server", of["fuzz_exceptions"]),
        ("levels unlocked without the key", of["unlocked_without_key"]),
        ("images activated without a good signature", of["activated_unsigned"]),
    ]
    return table(("", "figure"), rows)


def times(of: dict[str, Any]) -> str:
    """The shipped release over the simulated bus."""
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
    heads = ("bus", "tester's frames lost each way", "seconds", "frames of diagnosis", "bus load", "requests repeated")
    return f"""{table(heads, rows)}

{of["flash_times"][0]["bytes"]} bytes, from the first request to the confirmation, in virtual time, beside the control
traffic of an ECU that is not in control; a restart of the ECU takes 0.3 s of it."""


def _ways(seeds: int) -> str:
    return "one way" if seeds == 1 else f"{seeds} ways"
