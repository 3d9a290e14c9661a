"""The loader in C, storage and diagnosis, against its specification in Python, and under hostile requests.

    python -m tests.proofs.loader_in_c --json results/flash_c.json

Storage: the supply cut at every operation of the flash memory, altered images, forged records, calls at random.
Diagnosis: testers drive both ECUs, whose frames must be the same at the same times; then hostile requests while
sanitisers watch.
"""

import hashlib
import subprocess
import tempfile
from functools import partial
from pathlib import Path
from typing import Annotated, Any, Final

import typer

from contract.errors import StillwakeError
from tests.can_bridge.flashing.releases import keys
from tests.can_bridge.flashing.store_ecu import SECRET
from tests.proofs.command_line import JsonFile, Processes, Seed, in_parts, report
from tests.proofs.loader_in_c.node_library import GEOMETRY, Library, build, sources
from tests.proofs.loader_in_c.node_program import play, requests_of
from tests.proofs.loader_in_c.node_sizes import sizes
from tests.proofs.loader_in_c.node_twin import CONFIGS, World, may_run, rules_of, world
from tests.proofs.loader_in_c.store_proof import storage_figures

SANITISED: Final = ("-O1", *GEOMETRY, "-fsanitize=address,undefined", "-fno-sanitize-recover=all", "-g1")
VIOLATIONS: Final = (
    *("stuck", "unlocked_without_key", "activated_unsigned"),
    *("releases_lost", "went_back", "wrong_answers"),
)
REACHED: Final = ("trials", "positive", "pending", "tool_unlocked", "tool_packets")
"""Counts that must not be 0, since the program would otherwise show little."""
_WRONG: Final = ("first_findings", "planted_missed", "branches_missed")


def main(
    json_file: JsonFile = None,
    seed: Seed = 0,
    processes: Processes = 2,
    programs: Annotated[int, typer.Option(help="Testers against both ECUs, for each kind of frames.", min=1)] = 2000,
    fuzz_requests: Annotated[int, typer.Option(help="Hostile requests under sanitisers.", min=1)] = 1_000_000,
    images: Annotated[int, typer.Option(help="Images that are altered.", min=1)] = 1_000_000,
    calls: Annotated[int, typer.Option(help="Calls of the store, at random.", min=1)] = 20_000,
    records: Annotated[int, typer.Option(help="Forged records, and as many logs of records.", min=1)] = 10_000,
    seconds: Annotated[int, typer.Option(help="Second cuts in the recovery from each first one.", min=0)] = 2,
    eighths: Annotated[int, typer.Option(help="Of all operations, in which the supply is cut.", min=1, max=8)] = 8,
    faults: Annotated[bool, typer.Option(help="Plant faults in the store, and count its branches, too.")] = True,
) -> None:
    """Compare, cut and fuzz; then print what was lost or differed, which must be nothing."""
    sizes_of: dict[str, Any] = {
        "images": images, "calls": calls, "records": records, "seconds": seconds, "eighths": eighths, "faults": faults,
    }  # fmt: skip
    storage = storage_figures(seed=seed, processes=processes, **sizes_of)
    differences, compared = list[str](), 0
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        for kind, config in CONFIGS.items():
            build(sources(config), folder / kind, f"{kind}.so")
            for found, calls_made in in_parts(partial(_played, kind, folder, seed), programs, 25, processes, kind):
                differences += found
                compared += calls_made
        of = world("fd", Library(sources(CONFIGS["fd"]), folder / "fd" / "fd.so"))
        corpus(of, folder / "corpus", range(seed, seed + 60))
        program = build(sources(of.config), folder / "fuzz", "node_fuzz", SANITISED)
        fuzzed: dict[str, Any] = {**fuzz(program, folder / "corpus", seed, fuzz_requests)}
        (folder / "sizes").mkdir()
        different = storage["mismatches"] + storage["image_mismatches"] + len(differences)
        figures = storage | {
            "programs": programs * len(CONFIGS), "calls_compared": compared, "mismatches": different,
            "fuzz_requests": fuzzed.pop("requests"), "fuzz": fuzzed, **sizes(folder / "sizes"),
        }  # fmt: skip
    report(
        json_file, "loader in C", figures, packages=("stillwake", "cryptography"), seed=seed, programs=programs,
        **sizes_of,
    )  # fmt: skip
    wrong = [*differences, *(one for name in _WRONG for one in storage.get(name, []))]
    if different or wrong or any(fuzzed[name] for name in VIOLATIONS) or not all(fuzzed[name] for name in REACHED):
        raise StillwakeError(f"{different} differ, {fuzzed}: {wrong[:1]}")


def _played(kind: str, folder: Path, seed: int, numbers: range) -> tuple[list[str], int]:
    """What differed, and how many calls were compared."""
    of = world(kind, Library(sources(CONFIGS[kind]), folder / kind / f"{kind}.so"))
    played = [play(of, number, drawn_by=str(seed)) for number in numbers]
    found = [f"{kind} {seed} {number}: {text}" for number, twins in zip(numbers, played, strict=True)
             for text in twins.differences]  # fmt: skip
    return found, sum(twins.compared for twins in played)


def corpus(of: World, file: Path, seeds: range) -> None:
    """What the program reads: a vehicle, its production, and the requests of testers."""
    good = b"".join(hashlib.sha256(image).digest() for image in of.images.values() if may_run(of, image))
    parts = [rules_of(of), SECRET, keys(), of.images["one"], good, *requests_of(of, seeds)]
    file.write_bytes(b"".join(len(part).to_bytes(4, "little") + part for part in parts))


def fuzz(executable: Path, file: Path, seed: int, requests: int) -> dict[str, int]:
    """What the program counted. Raises RuntimeError with a sanitiser's report."""
    command = [str(executable), str(file), str(seed), str(requests)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    if done.returncode != 0:
        raise RuntimeError(f"node_fuzz ended with {done.returncode}: {done.stderr[:2000]}")
    return {name: int(count) for name, count in (line.split() for line in done.stdout.splitlines())}
