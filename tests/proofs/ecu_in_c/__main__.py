"""The ECU in C held against the Python ECU, and how sharp that comparison is.

    python -m tests.proofs.ecu_in_c ecu-c --steps 1000000 --json results/ecu_c.json

A million random control periods through both, in vehicles with six kinds of settings; faults planted in C; branches
of C that were taken; mutants of its gate, protection, reception, timing and fail-safe; deviations from MISRA C.
"""

import hashlib
import tempfile
from collections import Counter
from collections.abc import Iterator
from contextlib import ExitStack
from functools import cache, partial
from pathlib import Path
from typing import Annotated, Any, Final

import typer
from rich.table import Table

from contract.results import versions
from firmware_sim.in_c.compiler import compiler_version, host_compiler
from tests.proofs.command_line import JsonFile, Processes, console, main, save, spread, track
from tests.proofs.ecu_in_c import branch_coverage, campaign, misra, mutants
from tests.proofs.ecu_in_c.library import Library, sources
from tests.proofs.ecu_in_c.planted import PLANTED
from tests.proofs.ecu_in_c.variants import VARIANTS

STRETCH: Final = 2_500
"""Periods of one seed."""
TRIED: Final = 3_000
"""Periods of a recording that planted faults, mutants and branches are tried with."""
SEEDS: Final = ("1", "3", "0")
"""Seeds of the recordings; odd ones start from states near an edge now and then."""


def ecu_in_c(
    steps: Annotated[int, typer.Option("--steps", min=1, help="Control periods in all.")] = 1_000_000,
    seed: Annotated[int, typer.Option("--seed", help="Of the first stretch.")] = 0,
    processes: Processes = 2,
    json_file: JsonFile = None,
) -> None:
    """Live through random control periods with both ECUs, and measure how sharp the comparison is."""
    figures = _summed(list(_stretches(steps, seed, processes)))
    console.print(_modes(figures))
    for line in figures["first_mismatches"]:
        console.print(line)
    figures |= sharpness()
    console.print(_table(figures))
    save(
        json_file,
        figures=figures,
        facts={
            "seed": seed,
            "variants": list(VARIANTS),
            "sources_sha256": sources_hash(),
            "compiler": compiler_version(host_compiler()),
            "versions": versions("numpy", "cffi", "pycparser", "gcovr", "cppcheck"),
        },
    )
    if figures["mismatches"] or figures["planted_found"] < figures["planted"]:
        raise typer.Exit(1)


def sources_hash() -> str:
    """Hash of all that is compared, in C."""
    everything = hashlib.sha256()
    for config in VARIANTS.values():
        for name, content in sorted(sources(config).items()):
            if not name.startswith("twin"):
                everything.update(name.encode() + content)
    return everything.hexdigest()[:16]


def _stretches(steps: int, seed: int, processes: int) -> Iterator[campaign.Stretch]:
    lengths = [min(STRETCH, steps - start) for start in range(0, steps, STRETCH)]
    work = partial(_lived_through, seed=seed)
    unit = f"stretches of {STRETCH} periods"
    yield from track(spread(work, enumerate(lengths), processes), "ecu-c", unit, total=len(lengths))


def _lived_through(item: tuple[int, int], *, seed: int) -> campaign.Stretch:
    number, length = item
    name = list(VARIANTS)[number % len(VARIANTS)]
    return campaign.stretch(_library(name), name, str(seed + number // len(VARIANTS)), length)


@cache
def _library(name: str) -> Library:
    """One for each process."""
    with tempfile.TemporaryDirectory() as folder:
        # Once it is loaded, the file is not needed any more.
        return campaign.build(name, Path(folder))


def _summed(stretches: list[campaign.Stretch]) -> dict[str, Any]:
    mismatches = [str(one.mismatch) for one in stretches if one.mismatch is not None]
    return {
        "steps": sum(one.steps for one in stretches),
        "mismatches": len(mismatches),
        "first_mismatches": mismatches[:10],
        "modes": dict(sum((one.modes for one in stretches), Counter[str]())),
    }


def sharpness() -> dict[str, Any]:
    """Planted faults, branches, mutants and deviations from MISRA C."""
    with ExitStack() as stack:
        scratch = Path(stack.enter_context(tempfile.TemporaryDirectory()))
        recordings = {name: list(_recordings(name)) for name in track(VARIANTS, "recordings", "variants")}
        planted = [item.what for item in track(PLANTED, "planted faults", "faults") if not _is_found(item, scratch)]
        found: dict[str, Any] = {
            "planted": len(PLANTED),
            "planted_found": len(PLANTED) - len(planted),
            "planted_missed": planted,
        }
        if branch_coverage.is_possible():
            coverage = branch_coverage.measured(recordings, scratch)
            found |= {
                "branches": coverage.branches,
                "branch_coverage_percent": round(coverage.percent, 2),
                "branches_missed": coverage.missed,
            }
        tried = mutants.tried(recordings, scratch)
        found |= {
            "mutants": tried.mutants,
            "survivors": len(tried.survivors),
            "survivors_unexplained": tried.unexplained,
        }
        if misra.is_possible():
            deviations = misra.found()
            found |= {
                "misra_deviations": sum(deviations.values()),
                "misra_rules": len({rule for _, rule in deviations}),
                "misra_unlisted": misra.unlisted(deviations),
            }
    return found


def _recordings(name: str) -> Iterator[bytes]:
    library = _library(name)
    for seed in SEEDS:
        yield campaign.recording(name, seed, TRIED, library.layout)


def _is_found(item: Any, scratch: Path) -> bool:
    contents = item.into(sources(VARIANTS[item.variant]))
    library = Library(contents, scratch / f"planted_{PLANTED.index(item)}.so")
    return any(campaign.stretch(library, item.variant, seed, TRIED).mismatch is not None for seed in SEEDS)


def _modes(figures: dict[str, Any]) -> Table:
    table = Table("mode", "periods", box=None, pad_edge=False)
    for name, count in figures["modes"].items():
        table.add_row(name, str(count))
    table.caption = (
        f"{figures['steps']} periods in {len(VARIANTS)} kinds of vehicles, {figures['mismatches']} mismatches"
    )
    return table


def _table(figures: dict[str, Any]) -> Table:
    table = Table("how sharp", "", box=None, pad_edge=False)
    table.add_row("planted faults found", f"{figures['planted_found']} of {figures['planted']}")
    if "branches" in figures:
        table.add_row("branches taken", f"{figures['branch_coverage_percent']} % of {figures['branches']}")
    table.add_row("mutants that survive", f"{figures['survivors']} of {figures['mutants']}")
    if "misra_deviations" in figures:
        table.add_row("deviations from MISRA C", f"{figures['misra_deviations']} of {figures['misra_rules']} rules")
    return table


if __name__ == "__main__":
    main({"ecu-c": ecu_in_c})
