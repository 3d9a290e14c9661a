"""Damaged bundles, manifests, graphs and C headers by the thousand: each is refused by its name, or does no harm.

Every case is made from a small sound release and a seed. It may end in two ways: in an error of the project's own, in
one printable line; or accepted. What is accepted without a manifest of its own (image, folder) must have the content
that the sound bundle has. A manifest or a graph whose hashes were made right again is another one, which nobody signed:
it must keep its rules, and a graph must answer in ONNX Runtime within its limits or be refused by name. Anything else
ends the run with the case's number.
"""

import hashlib
import tempfile
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from functools import cache, partial
from pathlib import Path
from random import Random
from time import perf_counter
from typing import Annotated, Any, Final, NamedTuple

import typer

from contract.controller.c_folder import PROGRAM_SETTINGS, ProgramSettings
from contract.errors import StillwakeError
from contract.release import bundle
from contract.release.checks import CONTROLLER, Bundle, read_checked
from contract.release.container import files_of, image_of
from contract.release.manifest import MANIFEST, Manifest
from contract.runtime.onnx_session import OnnxController
from export.to_c.library import c_library
from tests.can_bridge.flashing.releases import small_program, untrained
from tests.proofs.command_line import JsonFile, Processes, Seed, in_parts, max_rss_kib, report
from tests.proofs.release import damage

KINDS: Final = {"image": 30, "folder": 15, "manifest's bytes": 10, "manifest's values": 20, "graph": 20, "C header": 5}
"""Shares of the cases."""
PIECE: Final = 1000  # cases that a process runs at a time


class FuzzError(StillwakeError):
    """A case that was neither refused by name nor harmless; the message has its number."""


class Sound(NamedTuple):
    """What all cases are made from: a bundle, and the header of a C library of the same program."""

    files: Mapping[str, bytes]
    header: bytes
    manifest: Manifest
    max_rss_mb: float  # of the process by then


@cache
def sound() -> Sound:
    """A small release that nobody trained, with the shipped release's facts around it."""
    manifest, graph = untrained()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name, "sound")
        bundle.write(folder, manifest, {CONTROLLER: graph})
        files = {item.name: item.read_bytes() for item in folder.iterdir()}
        loaded, header = bundle.load(folder).manifest, c_library(small_program())[PROGRAM_SETTINGS]
    return Sound(files=files, header=header, manifest=loaded, max_rss_mb=max_rss_kib() / 1024)


class Ended(NamedTuple):
    """How a case ended: with the error's name, or "" if it was accepted; after so many seconds of wall clock."""

    kind: str
    error: str
    seconds: float


def figures(cases: Sequence[Ended]) -> dict[str, Any]:
    """By kind: cases, how many were accepted and refused, the latter by error, and the slowest one's seconds."""
    kinds = {}
    for kind in KINDS:
        if own := [case for case in cases if case.kind == kind]:
            refused = Counter(case.error for case in own if case.error)
            kinds[kind] = {
                "cases": len(own),
                "accepted": len(own) - refused.total(),
                "refused": dict(refused.most_common()),
                "slowest_s": max(case.seconds for case in own),
            }
    return {"kinds": kinds, "cases": len(cases), "slowest_s": max(case.seconds for case in cases)}


def main(
    json_file: JsonFile = None,
    cases: Annotated[int, typer.Option(help="Damaged inputs, of all kinds together.", min=1)] = 100_000,
    seed: Seed = 0,
    processes: Processes = 1,
) -> None:
    """Damage bundles in many ways and load each; the table counts the outcomes."""
    parts = list(in_parts(partial(run_cases, seed), cases, PIECE, processes, "cases"))
    found = figures([case for part, _, _ in parts for case in part])
    found |= {"max_rss_mb": max(most for _, _, most in parts), "max_rss_before_mb": max(most for _, most, _ in parts)}
    report(json_file, "damaged", found, packages=("stillwake", "numpy", "onnxruntime"), seed=seed)


def run_cases(seed: int, numbers: range) -> tuple[list[Ended], float, float]:
    """Run some cases; the process's memory in MB before the first and at most. Raises as `run_case` does."""
    before = sound().max_rss_mb
    with tempfile.TemporaryDirectory() as folder:
        ended = [run_case(Path(folder), seed, number) for number in numbers]
    return ended, before, max_rss_kib() / 1024


def run_case(folder: Path, seed: int, number: int) -> Ended:
    """Make one case and have it read; raises FuzzError if it is wrongly accepted, or its error is no printable line."""
    # Not `hash`, which differs between processes.
    rng = Random(int.from_bytes(hashlib.sha256(f"{seed} {number}".encode()).digest()[:8], "big"))
    kind = rng.choices(list(KINDS), weights=list(KINDS.values()))[0]
    read, refused = _reader(kind, folder, rng), ""
    began = perf_counter()
    try:
        read()
    except Exception as error:
        if isinstance(error, FuzzError) or not isinstance(error, StillwakeError) or not str(error).isprintable():
            raise FuzzError(f"case {number} of seed {seed}, {kind}: {error!r}") from error
        refused = type(error).__name__
    return Ended(kind, refused, perf_counter() - began)


def _reader(kind: str, folder: Path, rng: Random) -> Callable[[], object]:
    """Damage one of the sound files, put it into a folder, and have it read."""
    path, files = folder / "damaged", dict(sound().files)
    if kind == "C header":
        content = damage.bytes_of(rng, sound().header)
        return lambda: _read_header(content)
    if kind == "image":
        content = damage.bytes_of(rng, image_of(files))
        return lambda: _identical(read_checked(path, files_of(content)))
    if kind == "graph":
        files |= damage.with_controller(files, CONTROLLER, damage.bytes_of(rng, files[CONTROLLER]))
    elif kind == "manifest's values":
        files[MANIFEST] = damage.manifest_of(rng, files[MANIFEST])
    else:
        name = rng.choice(sorted(files)) if kind == "folder" else MANIFEST
        files[name] = damage.bytes_of(rng, files[name])
    path.mkdir(exist_ok=True)
    for name, content in files.items():
        (path / name).write_bytes(content)
    if kind == "graph":
        return lambda: OnnxController.of(bundle.load(path))
    return lambda: bundle.load(path) if kind == "manifest's values" else _identical(bundle.load(path))


def _read_header(content: bytes) -> None:
    settings = ProgramSettings(content)
    settings.multiply_accumulates()
    for name in ("SW_PROGRAM_SHA256", "SW_DBC_SHA256", "SW_SENSOR_NAMES", "SW_PRECISION"):
        settings.text(name)


def _identical(loaded: Bundle) -> None:
    contents = {name: content for name, content in sound().files.items() if name != MANIFEST}
    if (loaded.manifest, dict(loaded.files)) != (sound().manifest, contents):
        raise FuzzError("accepted, though its content is another one")
