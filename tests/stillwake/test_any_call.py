"""Whatever numbers, paths and words a user gives: a status, at most one line to stderr, nothing half-written.

The work itself is cut off where it begins: only what a command does before it, and how it ends, is looked at.
"""

import io
import os
import shutil
import sys
import tempfile
from collections.abc import Callable, Iterator
from contextlib import chdir, redirect_stderr, redirect_stdout
from importlib import import_module
from pathlib import Path
from typing import Any

import pytest
from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

import stillwake.__main__
from contract.errors import StillwakeError
from contract.recording import dataset
from contract.release import signing
from docs import command_line
from tests.conftest import kept_command
from tests.stillwake.calls import calls

ASKED = os.environ.get("STILLWAKE_CALLS")
EXAMPLES, DERANDOMIZE = (3, True) if ASKED is None else (int(ASKED), False)
"""Calls of each verb. They are the same in every test run; STILLWAKE_CALLS=500 looks at as many others."""
RUNS = 12
"""Calls of the flow solver until the work counts as begun: a start from rest takes some of them."""
CONTINUED = (".parts", ".checkpoints")
"""What a stopped command keeps, to go on from."""
BEGINNINGS = (
    "train.pipeline.fit_joint",
    "export.release.pipeline.rounded_on",
    "export.release.pipeline.lower",
    "firmware_sim.mcu.measure.compile_for_cortex_m7",
    "wake.recording.parallel.run_parallel",
    "firmware_sim.campaign.conduct.execute",
    "train.refinement.pipeline.refine",
    "wake.pictures.drawing.save_figure",
    "can_bridge.tools.raw_bus.open_bus",
    "can_bridge.tester.transport.open_client",
    "firmware_sim.ecu.daemon.service.serve",
    "firmware_sim.ecu.daemon.store_service.serve_store",
    "firmware_sim.latency.running.recorded",
    "firmware_sim.live.serving.server.serve",
)
"""Where the work of a command begins."""


class WorkBeganError(StillwakeError):
    """Everything was accepted."""


def begins(*_arguments: object, **_named: object) -> None:
    raise WorkBeganError("work began")


@pytest.fixture(scope="module")
def no_work() -> Iterator[Callable[[], None]]:
    """Let no command get to its work; returns what sets the count of solver runs back."""
    count = [0]

    def run(_solver: object, flow: Any, **_named: object) -> None:
        flow.velocities[:] *= 1.01
        count[0] += 1
        if count[0] > RUNS:
            begins()

    with pytest.MonkeyPatch.context() as patch:
        for name in BEGINNINGS:
            # By the module itself: another test may have imported its package again.
            module, _, function = name.rpartition(".")
            patch.setattr(import_module(module), function, begins)
        patch.setattr("wake.solver.navier_stokes.FlowSolver.run", run)
        patch.setattr("contract.recording.dataset.read", _remembered(dataset.read))
        patch.setenv("PATH", "")
        patch.setattr("typer.main.get_command", kept_command)
        yield lambda: count.__setitem__(0, 0)


def _remembered(read: Callable[[Path], Any]) -> Callable[[Path], Any]:
    """Reads each recording that lies outside the temporary folders once: it takes a second."""
    known: dict[Path, Any] = {}

    def remembered(path: Path) -> Any:
        if not path.is_absolute():
            return read(path)
        if path not in known:
            known[path] = read(path)
        return known[path]

    return remembered


def prepare(folder: Path, release: Path) -> None:
    """Files of each kind that a path may lead to."""
    for name in ("folder", "empty-folder"):
        (folder / name).mkdir()
    for name in ("file", "folder/inside"):
        (folder / name).write_text("text\n")
    (folder / "empty").touch()
    (folder / "frames.log").write_text("(1.0) can0 123#00\n(1.1) can0 130##1000102\n")
    (folder / "settings.toml").write_text("[ecu]\ndelay_steps = 1\n")
    (folder / "link-to-nowhere").symlink_to("nowhere")
    (folder / "loop").symlink_to("loop")
    shutil.copytree(release, folder / "bundle")
    keys = signing.write_key_pair(folder / "keys", Ed25519PrivateKey.from_private_bytes(bytes(32)))
    assert keys is not None
    for path in (folder / "keys").iterdir():
        path.rename(folder / path.name)
    (folder / "keys").rmdir()


def listing(folder: Path) -> dict[str, bytes | None]:
    """Every file's bytes by its path, folders and links as None."""
    return {
        str(path.relative_to(folder)): path.read_bytes() if path.is_file() and not path.is_symlink() else None
        for path in sorted(folder.rglob("*"))
        if not any(part.endswith(CONTINUED) for part in path.parts)
    }


def call(words: list[str]) -> tuple[int, str, str]:
    """Exit status, stdout and stderr of `stillwake` with these words, in this process."""
    out, err, before = io.StringIO(), io.StringIO(), sys.argv
    sys.argv = ["stillwake", *words]
    try:
        with redirect_stdout(out), redirect_stderr(err), pytest.raises(SystemExit) as stop:
            stillwake.__main__.main()
    finally:
        sys.argv = before
    assert isinstance(stop.value.code, int)
    return stop.value.code, out.getvalue(), err.getvalue()


@pytest.mark.proofs  # long; refusals by name stay
@pytest.mark.slow  # some calls of every verb
def test_any_call_ends_well(random_release, no_work) -> None:
    @settings(
        max_examples=EXAMPLES,
        deadline=None,
        database=None,
        derandomize=DERANDOMIZE,
        suppress_health_check=list(HealthCheck),
    )
    @given(data=st.data())
    def check(verb: str, command: Any, data: st.DataObject) -> None:
        words = data.draw(calls(verb, command), label="stillwake")
        with tempfile.TemporaryDirectory() as name, chdir(name):
            folder = Path(name).resolve()
            prepare(folder, random_release)
            before = listing(folder)
            no_work()
            status, out, err = call(words)
            after = listing(folder)
        assert status in {0, 1, 2, 3, 4}, (words, status, err)
        assert "Traceback" not in err, words
        assert "\x1b[2J" not in out + err, words
        if status == 1:
            assert err.startswith("error: ") and err.count("\n") == 1, (words, err)
        if status != 0:
            assert after == before, (words, set(after) ^ set(before))

    for verb, command in command_line.commands().items():
        check(verb, command)
