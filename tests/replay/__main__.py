"""The command `python -m tests.replay [--renew] [--only DRIVE] [--json FILE]`: shows how a change affects commands and
states. With --renew it makes the recordings: all drives in closed loop, the answers of the ECU in C to each, and their
origin. Finished drives are stored in a folder named after the hash of their sources, so that a stopped recording can
continue.

Exit status 3: an answer differs from the recorded one. Exit status 4: the recordings belong to another release, and
nothing was compared.
"""

import hashlib
import json
import os
import shutil
import time
from collections.abc import Sequence
from datetime import date
from fnmatch import fnmatch
from functools import partial
from typing import Annotated, Any, ClassVar, Final

import typer
from rich.table import Table

from benchmarks.common.command_line import ROOT, JsonFile, console, made_from, track
from contract.atomic import replacing
from contract.config.loading import load_config
from contract.errors import StillwakeError
from contract.results import machine, versions
from contract.side_by_side import process_pool
from stillwake.console.outputs import save_json
from stillwake.parts.differentiable_wake import mesh_of
from tests.proofs.command_line import main as run
from tests.replay import judging
from tests.replay.judging import Job, Verdict, verdict
from tests.replay.recording import Plan, plans, record, shipped
from tests.replay.shelf import SHELF, SUFFIX, ShelfError, read
from tests.replay.shelf import save as keep
from wake.plants import own_wake
from wake.truck.state import save_state

CHANGED: Final = 3
PROCESSES: Final = 2
PROVENANCE: Final = "provenance.json"
PARTS: Final = ROOT / "build" / "replay"


class OtherReleaseError(StillwakeError):
    status: ClassVar[int] = 4


def main(
    json_file: JsonFile = None,
    again: Annotated[bool, typer.Option("--renew", help="Record the drives again, and print the difference.")] = False,
    only: Annotated[list[str], typer.Option(help="Drives by their names, such as 'frames_*' (repeatable).")] = [],  # noqa: B006
) -> None:
    """Replay the recorded drives through both ECUs, and compare their answers with the recorded ones."""
    if again:
        _renew(only)
        return
    began, origin = time.monotonic(), provenance()
    paths = [path for path in sorted(SHELF.glob(f"*{SUFFIX}")) if _is_chosen(path.name.removesuffix(SUFFIX), only)]
    drives = {drive.name: drive for drive in map(read, paths)}
    if not drives:
        raise ShelfError(f"{SHELF}: no drive of the name {', '.join(only)}; --renew records what drives.toml has")
    is_same = all(origin[name] == value for name, value in facts().items())
    jobs, refused = judging.c_jobs(paths, judging.c_library())
    if lost := [why for name, why in refused.items() if "c" in drives[name].answers]:
        raise ShelfError(f"the ECU in C refuses what it answered when it was recorded: {lost[0]}")
    jobs += [Job(half) for half in (paths[::2], paths[1::2]) if half]
    with process_pool(PROCESSES) as pool:
        done = track(pool.map(judging.answers, jobs), "replay", "parts", len(jobs))
        verdicts = [
            verdict(name, kind, old, new, exact=is_same or kind == "c")
            for found in done
            for name, kind, new in found
            if (old := drives[name].answers.get(kind)) is not None
        ]
    spent = {"seconds": round(time.monotonic() - began, 1), "cpu_seconds": round(sum(os.times()[:4]), 1)}
    differing = [one for one in verdicts if one.periods]
    _print(differing)
    if left := [name for name, drive in drives.items() if "c" not in drive.answers]:
        console.print(f"left out: {len(left)} drives that the ECU in C refused when recorded ({', '.join(left)})")
    if not is_same:
        console.print(f"recorded on another processor or with another library: Python to {judging.ROUNDING:g} U_inf W")
    periods = sum(len(drive.periods) for drive in drives.values())
    by_ecu = {}
    for kind in ("python", "c"):
        of_kind = [one for one in verdicts if one.kind == kind]
        by_ecu[kind] = {
            "drives": len(of_kind),
            "differing": sum(bool(one.periods) for one in of_kind),
            "differing_periods": sum(len(one.periods) for one in of_kind),
            "largest_change": max((one.largest for one in of_kind), default=0.0),
        }
    figures = {"drives": len(drives), "periods": periods, "by_ecu": by_ecu, **spent}
    save_json(json_file, figures=figures, facts={**origin, "python_to_the_bit": is_same, "left_out_in_c": left})
    console.print(f"{len(drives)} drives, {periods} periods in {spent['seconds']} s: {len(differing)} answers differ")
    if differing:
        judging.draw(differing, PARTS / "changed.png")
        console.print(f"{PARTS / 'changed.png'} shows them; where that is meant: make replay RENEW=1", soft_wrap=True)
        raise typer.Exit(CHANGED)


def provenance() -> dict[str, Any]:
    """Return the origin of the recordings; raises ShelfError without one, OtherReleaseError for another release."""
    try:
        origin: dict[str, Any] = json.loads((SHELF / PROVENANCE).read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise ShelfError(f"{SHELF / PROVENANCE}: {error}; make replay RENEW=1 records a shelf") from error
    if origin["digest"] != shipped().digest:
        raise OtherReleaseError(
            f"the shelf is of {origin['release']} ({origin['digest'][:12]}), shipped is {shipped().manifest.name} "
            f"({shipped().digest[:12]}): nothing is judged; make replay RENEW=1, and commit tests/replay/shelf with it"
        )
    return origin


def _renew(only: Sequence[str]) -> None:
    chosen = [plan for plan in plans(shipped().manifest.sensors) if _is_chosen(plan.name, only)]
    before = {}
    for path in SHELF.glob(f"*{SUFFIX}"):
        try:
            before[path.name] = read(path)
        except ShelfError as error:  # which is what the new one is for
            console.print(error)
    renew(chosen)
    pairs = [(before.get(f"{plan.name}{SUFFIX}"), read(SHELF / f"{plan.name}{SUFFIX}")) for plan in chosen]
    found = [
        verdict(new.name, kind, old.answers[kind], answers)
        for old, new in pairs
        for kind, answers in new.answers.items()
        if old is not None and kind in old.answers
    ]
    console.print(f"{len(chosen)} drives of {shipped().manifest.name} ({shipped().digest[:12]}): in closed loop")
    console.print(f"{sum(bool(one.periods) for one in found)} of {len(found)} answers that were there are others")
    _print([one for one in found if one.periods])


def facts() -> dict[str, Any]:
    """Return what the bits of the ECU in Python depend on."""
    return {"processor": machine().partition(",")[0], "versions": versions("onnxruntime", "numpy")}


def renew(chosen: Sequence[Plan]) -> None:
    """Record these drives. Recordings of other drives stay if they belong to the shipped release."""
    parts = PARTS / made_from(shipped().digest, "tests/replay")
    parts.mkdir(parents=True, exist_ok=True)
    start, targets = parts / "start.npz", [parts / f"{plan.name}{SUFFIX}" for plan in chosen]
    if not start.exists():
        save_state(start, own_wake(mesh_of(load_config())).state())
    missing = {target: plan for plan, target in zip(chosen, targets, strict=True) if not target.exists()}
    with process_pool(PROCESSES) as pool:
        list(track(pool.map(partial(record, start), missing, missing.values()), "drives", "drives", len(missing)))
        jobs, _ = judging.c_jobs(targets, judging.c_library())
        for found in track(pool.map(judging.answers, jobs), "ECU in C", "builds", len(jobs)):
            for name, kind, answers in found:
                drive = read(path := parts / f"{name}{SUFFIX}")
                drive.answers[kind] = answers
                keep(path, drive)
    kept = [path for path in SHELF.glob(f"*{SUFFIX}") if parts / path.name not in targets]
    targets += [path for path in kept if read(path).digest == shipped().digest]
    with replacing(SHELF) as temporary:
        temporary.mkdir()
        for path in targets:
            shutil.copyfile(path, temporary / path.name)
        digests = {path.name: hashlib.sha256(path.read_bytes()).hexdigest() for path in sorted(targets)}
        made = {"command": "make replay RENEW=1", "date": date.today().isoformat()}
        of = {"release": shipped().manifest.name, "digest": shipped().digest}
        text = json.dumps({**made, **of, **facts(), "sha256": digests}, indent=2)
        (temporary / PROVENANCE).write_text(text + "\n", encoding="utf-8")
    shutil.rmtree(parts)


def _is_chosen(name: str, only: Sequence[str]) -> bool:
    return not only or any(fnmatch(name, pattern) for pattern in only)


def _print(differing: Sequence[Verdict]) -> None:
    table = Table("drive", "ECU", "periods that differ", "first", "command by, U_inf W", "states, the first ones first")
    for one in sorted(differing, key=lambda one: (one.drive, one.kind)):
        named = ", ".join(one.changed[:4]) + f" of {len(one.changed)}" * (len(one.changed) > 4)
        count = f"{len(one.periods)} of {len(one.new.frames)}"
        table.add_row(one.drive, one.kind, count, str(one.periods[0]), f"{one.largest:.2g}", named)
    if differing:
        console.print(table)


if __name__ == "__main__":
    run({"replay": main})
