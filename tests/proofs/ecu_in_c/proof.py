"""The ECU in C held against the Python ECU, and how sharp that comparison is.

A million random control periods through both, in vehicles with ten kinds of settings; faults planted in C; branches
of C that were taken; mutants of its gate, protection, reception, timing, fail-safe, speed and past; deviations from
MISRA C.
"""

import hashlib
import tempfile
from collections import Counter
from functools import cache, partial
from pathlib import Path
from typing import Annotated, Any, Final

import typer

from benchmarks.common.command_line import track
from ecu.fail_safe import OperatingMode
from ecu.in_c.compiler import compiler_version, host_compiler
from tests.proofs.command_line import JsonFile, Processes, Seed, in_parts, report
from tests.proofs.ecu_in_c import branch_coverage, campaign, misra, mutants
from tests.proofs.ecu_in_c.library import Library, sources
from tests.proofs.ecu_in_c.planted import PLANTED, Planted
from tests.proofs.ecu_in_c.variants import VARIANTS

STRETCH: Final = 2_500  # periods of one seed
TRIED: Final = 3_000  # periods of a recording that planted faults, mutants and branches are tried with
SEEDS: Final = ("1", "3", "0")  # seeds of the recordings; odd ones start from states near an edge now and then


def ecu_in_c(
    steps: Annotated[int, typer.Option("--steps", min=1, help="Control periods in all.")] = 1_000_000,
    seed: Seed = 0,
    processes: Processes = 2,
    json_file: JsonFile = None,
) -> None:
    """Live through random control periods with both ECUs, and measure how sharp the comparison is."""
    stretches = list(in_parts(partial(_lived_through, seed=seed), steps, STRETCH, processes, "ecu-c"))
    mismatches = [one.mismatch for one in stretches if one.mismatch is not None]
    modes = sum((one.modes for one in stretches), Counter[str]())
    figures: dict[str, Any] = {
        "steps": sum(one.steps for one in stretches),
        "mismatches": len(mismatches),
        "first_mismatches": mismatches[:10],
        "modes": dict(modes),
        "modes_missed": sorted({mode.name for mode in OperatingMode} - modes.keys()),
    }
    with tempfile.TemporaryDirectory() as folder:
        figures |= sharpness(Path(folder))
    everything = hashlib.sha256()
    for name, content in (pair for config in VARIANTS.values() for pair in sorted(sources(config).items())):
        if not name.startswith("twin"):
            everything.update(name.encode() + content)
    facts: dict[str, Any] = {"seed": seed, "variants": list(VARIANTS), "sources_sha256": everything.hexdigest()[:16]}
    packages = ("numpy", "cffi", "pycparser", "gcovr", "cppcheck")
    report(json_file, "ecu-c", figures, packages=packages, **facts, compiler=compiler_version(host_compiler()))
    wrong = ("mismatches", "modes_missed", "planted_missed", "branches_missed", "survivors_unexplained")
    if any(figures.get(name) for name in (*wrong, "misra_unlisted")):
        raise typer.Exit(1)


def _lived_through(part: range, *, seed: int) -> campaign.Stretch:
    number = part.start // STRETCH
    name = list(VARIANTS)[number % len(VARIANTS)]
    return campaign.stretch(_library(name), name, str(seed + number // len(VARIANTS)), len(part))


@cache
def _library(name: str) -> Library:
    with tempfile.TemporaryDirectory() as folder:
        # Once it is loaded, the file is not needed any more.
        return Library(sources(VARIANTS[name]), Path(folder, "ecu.so"))


def sharpness(scratch: Path) -> dict[str, Any]:
    recordings = {
        name: [campaign.recording(name, seed, TRIED, _library(name).layout) for seed in SEEDS]
        for name in track(VARIANTS, "recordings", "variants")
    }
    missed = [item.what for item in track(PLANTED, "planted faults", "faults") if not _is_found(item, scratch)]
    figures = {"planted": len(PLANTED), "planted_found": len(PLANTED) - len(missed), "planted_missed": missed}
    if branch_coverage.is_possible():
        figures |= branch_coverage.measured(recordings, scratch)
    figures |= mutants.tried(recordings, scratch)
    if misra.CPPCHECK.is_file():
        deviations = misra.deviations()
        figures |= {
            "misra_deviations": sum(deviations.values()),
            "misra_rules": len({rule for _, rule in deviations}),
            "misra_unlisted": misra.unlisted(deviations),
        }
    return figures


def _is_found(item: Planted, scratch: Path) -> bool:
    library = Library(item.into(sources(VARIANTS[item.variant])), scratch / f"planted_{PLANTED.index(item)}.so")
    return any(campaign.stretch(library, item.variant, seed, TRIED).mismatch is not None for seed in SEEDS)
