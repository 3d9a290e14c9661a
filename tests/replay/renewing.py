"""Renewal of the recordings: all drives in closed loop, the answers of the ECU in C to each, and their origin.

Finished drives are stored in a folder named after the hash of their sources, so that a stopped recording can continue.
"""

import hashlib
import json
import shutil
from collections.abc import Sequence
from datetime import date
from functools import partial
from pathlib import Path
from typing import Any, Final

from benchmarks.common.command_line import ROOT, track
from contract.atomic import replacing
from contract.config.loading import load_config
from contract.results import machine, versions
from contract.side_by_side import process_pool
from stillwake.parts.differentiable_wake import mesh_of
from tests.replay import judging
from tests.replay.recording import Plan, record, shipped
from tests.replay.shelf import SHELF, SUFFIX, read, save
from wake.plants import own_wake
from wake.truck.state import save_state

PROCESSES: Final = 2
PROVENANCE: Final = "provenance.json"
PARTS: Final = ROOT / "build" / "replay"
_MADE_BY: Final = ("contract", "wake", "can_bridge", "ecu", "firmware_sim", "export", "tests/replay")


def facts() -> dict[str, Any]:
    """Return what the bits of the ECU in Python depend on."""
    return {"processor": machine().partition(",")[0], "versions": versions("onnxruntime", "numpy")}


def renew(plans: Sequence[Plan], shelf: Path = SHELF) -> None:
    """Record these drives. Recordings of other drives stay if they belong to the shipped release."""
    parts = PARTS / _made_from()
    parts.mkdir(parents=True, exist_ok=True)
    start, targets = parts / "start.npz", [parts / f"{plan.name}{SUFFIX}" for plan in plans]
    if not start.exists():
        save_state(start, own_wake(mesh_of(load_config())).state())
    missing = {target: plan for plan, target in zip(plans, targets, strict=True) if not target.exists()}
    with process_pool(PROCESSES) as pool:
        list(track(pool.map(partial(record, start), missing, missing.values()), "drives", "drives", len(missing)))
        jobs, _ = judging.c_jobs(targets, judging.c_library())
        for found in track(pool.map(judging.answers, jobs), "ECU in C", "builds", len(jobs)):
            for name, kind, answers in found:
                drive = read(path := parts / f"{name}{SUFFIX}")
                drive.answers[kind] = answers
                save(path, drive)
    kept = [path for path in shelf.glob(f"*{SUFFIX}") if parts / path.name not in targets]
    targets += [path for path in kept if read(path).digest == shipped().digest]
    with replacing(shelf) as temporary:
        temporary.mkdir()
        for path in targets:
            shutil.copyfile(path, temporary / path.name)
        digests = {path.name: hashlib.sha256(path.read_bytes()).hexdigest() for path in sorted(targets)}
        made = {"command": "make replay RENEW=1", "date": date.today().isoformat()}
        of = {"release": shipped().manifest.name, "digest": shipped().digest}
        text = json.dumps({**made, **of, **facts(), "sha256": digests}, indent=2)
        (temporary / PROVENANCE).write_text(text + "\n", encoding="utf-8")
    shutil.rmtree(parts)


def _made_from() -> str:
    everything = hashlib.sha256(shipped().digest.encode())
    for path in (path for folder in _MADE_BY for path in sorted((ROOT / folder).rglob("*"))):
        if path.suffix in (".py", ".c", ".h", ".toml", ".dbc"):
            everything.update(path.read_bytes())
    return everything.hexdigest()[:12]
