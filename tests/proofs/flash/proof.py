"""The supply cut at every write of flashing a release: whether the ECU ever stands without a controller it can trust.

    python -m tests.proofs.flash --json results/flash.json
    python -m tests.proofs.flash --replay 0.123.45

The tester's own steps drive the UDS server, the store and a simulated memory, with the shipped release. Each operation
of the memory is torn in its middle once; in the recovery from each, some are torn again. After every power-on the image
that runs is checked as the ECU checks it, by its signature and every hash, and compared with the releases byte by byte;
then the same release is flashed again.
"""

from collections import Counter
from random import Random
from time import perf_counter
from typing import Annotated, Any, Final, NamedTuple

import typer

from benchmarks.common.command_line import track
from contract.errors import StillwakeError
from tests.proofs.command_line import JsonFile, console, report, spread
from tests.proofs.flash.cuts import KINDS, Case, Tally, walk

PIECE: Final = 100
"""Cuts that a process makes in one go; it repeats the sequence for them."""


class ProofError(StillwakeError):
    """A case in which something was lost; the message has the first one's name."""


class Piece(NamedTuple):
    """Some of the cases of one walk: every `of`th operation from `number` on, and a share of the second cuts."""

    seed: int
    number: int
    of: int
    share: float


def main(
    json_file: JsonFile = None,
    replay: Annotated[str, typer.Option(help="Play one case again, such as 0.123.45.")] = "",
    every: Annotated[int, typer.Option(help="Cut in every so manieth operation; 1: in each.", min=1)] = 1,
    seeds: Annotated[int, typer.Option(help="Ways in which each call to the folder is torn.", min=1)] = 4,
    second_cuts: Annotated[
        float, typer.Option(help="Second cuts, were a recovery as long as the sequence.", min=0.0)
    ] = 1.0,
    workers: Annotated[int, typer.Option(help="Processes; the cases are the same for any number.", min=1)] = 2,
) -> None:
    """Cut, power on, judge, flash again, judge; then print what was lost, which must be nothing."""
    if replay:
        _replay(Case.parse(replay))
        return
    began = perf_counter()
    operations = walk(0, lambda number: False).operations
    of = -(-operations // (PIECE * every))
    pieces = [
        Piece(seed, number, of * every, second_cuts / operations)
        for seed in range(seeds)
        for number in range(0, of * every, every)
    ]
    total = Tally()
    for tally in track(spread(run_piece, pieces, workers), "cuts", "parts", len(pieces)):
        total.add(tally)
    figures = figures_of(total) | {"seconds_proof": perf_counter() - began}
    report(
        json_file,
        "flash",
        figures,
        packages=("stillwake", "onnxruntime", "cryptography", "udsoncan"),
        shown=list(figures),
        every=every,
        seeds=seeds,
        second_cuts=second_cuts,
        workers=workers,
    )
    if total.findings:
        first = total.findings[0]
        raise ProofError(f"{len(total.findings)} findings, the first: {first.case}, {first.kind}: {first.text}")


def run_piece(piece: Piece) -> Tally:
    """Its cases; of the second cuts a share, chosen by their numbers and the seed alone."""

    def second(first: int, number: int) -> bool:
        return Random(f"{piece.seed} {first} {number}").random() < piece.share

    return walk(piece.seed, lambda number: number % piece.of == piece.number, second)


def figures_of(total: Tally) -> dict[str, Any]:
    """What was counted."""
    lost = Counter(finding.kind for finding in total.findings)
    return {
        "operations": total.operations,
        "cuts_depth_1": total.cases[1],
        "cuts_depth_2": total.cases[2],
        "boots": total.boots,
        **{kind: lost[kind] for kind in KINDS},
        "cases_lost": [str(finding.case) for finding in total.findings][:20],
    }


def _replay(case: Case) -> None:
    tally = Tally(report=console.print)
    walk(case.seed, lambda n: n == case.first, lambda first, second: second == case.second, tally)
    for finding in tally.findings:
        console.print(f"{finding.case}: {finding.kind}: {finding.text}")
    if not any(tally.cases.values()):
        raise StillwakeError(f"case {case}: the sequence has {tally.operations} operations; name one of them")
    if not tally.findings:
        console.print(f"{case}: nothing was lost")
