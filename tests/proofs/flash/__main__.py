"""The supply cut at every write of flashing a release: whether the ECU ever stands without a controller it can trust.

    python -m tests.proofs.flash --json results/flash.json
    python -m tests.proofs.flash --replay flash-0123+0045

With it: hostile requests to the UDS server, and the time that the shipped release takes over a simulated bus.

The tester's own steps drive the UDS server, the store and a simulated memory, with the shipped release. Each operation
of the memory is torn in its middle once; in the recovery from each, some are torn again. After every power-on the image
that runs is checked as the ECU checks it, by its signature and every hash, and compared with the releases byte by byte;
then the same release is flashed again.
"""

from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass
from itertools import product
from random import Random
from time import perf_counter
from typing import Annotated, Any, Final

import typer
from rich.table import Table

from contract.errors import StillwakeError
from contract.results import versions
from stillwake.console.endings import status_of
from stillwake.console.stopping import ends_like_ctrl_c
from tests.proofs.command_line import JsonFile, console, save, spread, track
from tests.proofs.flash.cuts import KINDS, PLACES, Case, Tally, both_bad, walk
from tests.proofs.flash.flash_times import BUSES, LOSSES, measured
from tests.proofs.flash.fuzz import FuzzFigures, fuzz

PIECE: Final = 100
"""Cuts that a process makes in one go; it repeats the sequence for them."""
FUZZ_PIECE: Final = 25_000


class ProofError(StillwakeError):
    """A case in which something was lost; the message has the first one's name."""


@dataclass(frozen=True)
class Piece:
    """Some of the cases of one walk: every `of`th operation from `number` on, and a share of the second cuts."""

    kind: str
    seed: int
    number: int
    of: int
    share: float


def main(
    json_file: JsonFile = None,
    replay: Annotated[str, typer.Option(help="Play one case again, such as flash-0123+0045.")] = "",
    every: Annotated[int, typer.Option(help="Cut in every so manieth operation; 1: in each.", min=1)] = 1,
    seeds: Annotated[int, typer.Option(help="Ways in which each operation of the flash memory is torn.", min=1)] = 1,
    folder_seeds: Annotated[int, typer.Option(help="Ways in which each call to the folder is torn.", min=1)] = 4,
    second_cuts: Annotated[
        float, typer.Option(help="Second cuts, were a recovery as long as the sequence.", min=0.0)
    ] = 1.0,
    fuzz_requests: Annotated[int, typer.Option(help="Hostile requests to the UDS server.", min=0)] = 1_000_000,
    workers: Annotated[int, typer.Option(help="Processes; the cases are the same for any number.", min=1)] = 2,
) -> None:
    """Cut, power on, judge, flash again, judge; then print what was lost, which must be nothing."""
    if replay:
        _replay(Case.parse(replay))
        return
    began = perf_counter()
    operations = {kind: walk(kind, 0, lambda number: False).operations for kind in PLACES}
    pieces = [
        Piece(kind, seed, number, of * every, second_cuts / operations[kind])
        for kind, seed in [*product(["flash"], range(seeds)), *product(["folder"], range(folder_seeds))]
        for of in [-(-operations[kind] // (PIECE * every))]
        for number in range(0, of * every, every)
    ]
    tallies = {kind: both_bad(kind, 0) for kind in PLACES}
    for piece, tally in zip(pieces, track(spread(run_piece, pieces, workers), "cuts", "parts", len(pieces))):  # noqa: B905
        tallies[piece.kind].add(tally)
    starts = [(min(FUZZ_PIECE, fuzz_requests - start), start) for start in range(0, fuzz_requests, FUZZ_PIECE)]
    fuzzed = list(track(spread(run_fuzz, starts, workers), "requests", "parts", len(starts)))
    times = list(spread(run_time, product(BUSES, LOSSES), workers))
    figures = figures_of(tallies, fuzzed, times) | {"seconds_proof": perf_counter() - began}
    table = Table("", "figure")
    for name, value in figures.items():
        if name != "flash_times":
            table.add_row(name.replace("_", " "), f"{value:.3g}" if isinstance(value, float) else str(value))
    console.print(table)
    facts = {
        "every": every,
        "seeds": seeds,
        "folder_seeds": folder_seeds,
        "second_cuts": second_cuts,
        "workers": workers,
        "versions": versions("stillwake", "onnxruntime", "cryptography", "udsoncan"),
    }
    save(json_file, figures=figures, facts=facts)
    findings = [finding for tally in tallies.values() for finding in tally.findings]
    if findings:
        first = findings[0]
        raise ProofError(f"{len(findings)} findings, the first: {first.case}, {first.kind}: {first.text}")


def run_piece(piece: Piece) -> Tally:
    """Its cases."""
    return walk(piece.kind, piece.seed, lambda number: number % piece.of == piece.number, second_of(piece))


def run_fuzz(requests_and_seed: tuple[int, int]) -> FuzzFigures:
    """So many requests."""
    return fuzz(*requests_and_seed)


def run_time(frames_and_lost: tuple[str, float]) -> dict[str, Any]:
    """One flash over the bus."""
    return measured(*frames_and_lost)


def second_of(piece: Piece) -> Callable[[int, int], bool]:
    """A share of the second cuts, chosen by their numbers and the seed alone."""
    return lambda first, second: Random(f"{piece.seed} {first} {second}").random() < piece.share


def figures_of(tallies: dict[str, Tally], fuzzed: list[FuzzFigures], times: list[dict[str, Any]]) -> dict[str, Any]:
    """What was counted."""
    flash, folder = tallies["flash"], tallies["folder"]
    lost = Counter(finding.kind for tally in tallies.values() for finding in tally.findings)
    return {
        "operations": flash.operations,
        "calls_folder": folder.operations,
        "cuts_depth_1": flash.cases[1],
        "cuts_depth_2": flash.cases[2],
        "cuts_folder": folder.cases[1],
        "cuts_folder_depth_2": folder.cases[2],
        "both_slots_spoilt": flash.spoilt + folder.spoilt,
        "boots": flash.boots + folder.boots,
        **{kind: lost[kind] for kind in KINDS},
        "cases_lost": [str(finding.case) for tally in tallies.values() for finding in tally.findings][:20],
        "fuzz_requests": sum(piece.requests for piece in fuzzed),
        "fuzz_exceptions": sum(piece.exceptions for piece in fuzzed),
        "unlocked_without_key": sum(piece.unlocked_without_key for piece in fuzzed),
        "activated_unsigned": sum(piece.activated_unsigned for piece in fuzzed),
        "seconds_flash": next(row["seconds"] for row in times if (row["frames"], row["lost"]) == ("fd", 0.0)),
        "flash_times": sorted(times, key=lambda row: (row["frames"] != "fd", row["lost"])),
    }


def _replay(case: Case) -> None:
    tally = Tally(report=console.print)
    if case.first is None:
        tally = both_bad(case.kind, case.seed)
    else:
        walk(case.kind, case.seed, lambda n: n == case.first, lambda first, second: second == case.second, tally)
    for finding in tally.findings:
        console.print(f"{finding.case}: {finding.kind}: {finding.text}")
    if not any(tally.cases.values()) and not tally.spoilt:
        raise StillwakeError(f"case {case}: the sequence has {tally.operations} operations; name one of them")
    if not tally.findings:
        console.print(f"{case}: nothing was lost")


if __name__ == "__main__":
    app = typer.Typer(add_completion=False, pretty_exceptions_enable=False)
    app.command()(main)
    ends_like_ctrl_c()
    raise SystemExit(status_of(app))
