"""icoFoam that is missing, crashes, hangs or must be ended: always one error, never a wait without end or an orphan. A
script stands for icoFoam: it reads the pipes in the same order."""

import os
import re
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from unittest.mock import MagicMock

import numpy as np
import pytest

from contract.config.plant import FlowConfig
from contract.errors import PlantError
from tests.wake.conftest import field
from wake.openfoam import case
from wake.openfoam.case import pressure_points
from wake.openfoam.measurements import Readings
from wake.openfoam.mesh import Mesh
from wake.openfoam.plant import OpenFoamWake
from wake.openfoam.process import IcoFoam
from wake.openfoam.state import FoamState

READER = """
import sys, time
*pipes, steps, after = sys.argv[1:]
for step in range(int(steps)):
    for path in pipes:
        with open(path) as file:
            print(path, file.read().split(), flush=True)
print("something went wrong", flush=True)
exec(after)
"""


@pytest.fixture
def folder(coarse_mesh, tmp_path) -> Path:
    case.write_pipes(tmp_path, coarse_mesh, dt=0.01, steps=10, action=0.0)
    return tmp_path


def _reader(folder: Path, mesh: Mesh, steps: int, after: str) -> IcoFoam:
    pipes = [str(case.pipe(folder, patch)) for patch in case.DRIVEN]
    command = (sys.executable, "-c", READER, *pipes, str(steps), after)
    return IcoFoam(folder, mesh, patience_s=30.0, command=command)


def _gone(pid: int) -> bool:
    try:
        return Path(f"/proc/{pid}/stat").read_text().split()[2] == "Z"
    except FileNotFoundError:
        return True


def _wait_gone(pid: int) -> bool:
    deadline = time.monotonic() + 20.0
    while not _gone(pid) and time.monotonic() < deadline:
        time.sleep(0.01)
    return _gone(pid)


def test_a_missing_program_is_one_line(tmp_path):
    with pytest.raises(PlantError, match="install the Debian package `openfoam`") as caught:
        IcoFoam(tmp_path, command=("icoFoam-that-is-not-there",))
    assert "\n" not in str(caught.value) and not list(tmp_path.iterdir())


def test_steps_reach_the_program_inlet_first(folder, coarse_mesh):
    with _reader(folder, coarse_mesh, 2, "raise SystemExit(0)") as child:
        child.send(0.05)
        child.send(-0.02, stream=1.2)
        assert child.wait(30.0)
    lines = (folder / "log.icoFoam").read_text().splitlines()[:6]
    assert [Path(line.split()[0]).parent.name for line in lines] == ["inlet", "jetUpper", "jetLower"] * 2
    # Two equal faces a slot here: each carries half the flow over half the width.
    speeds = [{round(float(number), 9) for number in re.findall(r"'\(([-\d.]+)'", line)} for line in lines]
    assert speeds == [{speed} for speed in (1.0, 1.0, -1.0, 1.2, -0.4, 0.4)]


@pytest.mark.parametrize(
    ("after", "what"),
    [
        ("raise SystemExit(3)", "stopped with status 3"),
        ("import os, signal; os.kill(os.getpid(), signal.SIGFPE)", "ended by SIGFPE"),
        ("raise SystemExit(0)", "reached its end"),
        ("time.sleep(600)", r"has not finished a time step in 0\.5 s"),
    ],
)
def test_a_program_that_fails_is_one_error_with_its_last_words(folder, coarse_mesh, after, what):
    with _reader(folder, coarse_mesh, 1, after) as child:
        child.send(0.0)
        child._patience_s = 0.5 if "sleep" in after else 30.0
        with pytest.raises(PlantError, match=f"{what}.*something went wrong") as caught:
            child.wait_for_step()
        assert "\n" not in str(caught.value)
    assert not child.running


def test_a_program_that_does_not_listen_is_ended_by_force(tmp_path, monkeypatch):
    monkeypatch.setattr("wake.openfoam.process._GRACE_S", 0.2)
    deaf = (
        "import signal, time; signal.signal(signal.SIGTERM, signal.SIG_IGN); print('deaf', flush=True); time.sleep(600)"
    )
    child = IcoFoam(tmp_path, command=(sys.executable, "-c", deaf))
    while "deaf" not in (tmp_path / "log.icoFoam").read_text():
        assert child.running
        time.sleep(0.01)
    child.stop()
    assert not child.running


PARENT = """
import sys, time
from pathlib import Path
from wake.openfoam.process import IcoFoam
with IcoFoam(Path(sys.argv[1]), command=("sleep", "600")) as child:
    print(child._child.pid, flush=True)
    time.sleep(600)
"""


@pytest.mark.skipif(sys.platform != "linux", reason="asks Linux's /proc")
def test_no_orphan_is_left_behind_by_kill_9(tmp_path):
    root = Path(__file__).resolve().parents[3]
    parent = subprocess.Popen(
        [sys.executable, "-c", PARENT, str(tmp_path)], stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True,
        cwd=root, env={**os.environ, "PYTHONPATH": str(root)},
    )  # fmt: skip
    assert parent.stdout is not None
    pid = int(parent.stdout.readline())
    assert not _gone(pid)
    parent.kill()
    parent.wait(120.0)
    parent.stdout.close()
    assert _wait_gone(pid)


def test_divergence_in_the_last_step_is_refused_by_that_step_even_if_nobody_samples(coarse_mesh, tmp_path, monkeypatch):
    probes, steps = len(pressure_points(coarse_mesh)), iter((1.0, 1.0, np.nan))

    def readings(pressure: float) -> Readings:
        return Readings(forces=np.ones((3, 3, 3)), pressures=np.full(probes, pressure), wake=np.ones(3))

    follower = SimpleNamespace(read=lambda: readings(next(steps)))
    for name, stands in (("IcoFoam", MagicMock()), ("Follower", lambda _: follower)):
        monkeypatch.setattr(f"wake.openfoam.plant.{name}", stands)
    monkeypatch.setattr("wake.openfoam.plant.require_installed", lambda: None)
    cells = len(coarse_mesh.cells)
    files = {"U": field(np.ones((cells, 3))), "p": field(np.ones(cells))}
    start = FoamState(files=files, dt=0.1, readings=readings(1.0), action=0.0, substep=0)
    with OpenFoamWake(tmp_path / "case", start, FlowConfig(substeps=2), 0.5, duration=0.4) as plant:
        plant.advance(0.05)
        plant.advance_to(1, 0.0)
        assert plant.sample().t == pytest.approx(0.3)
        with pytest.raises(PlantError, match=r"the flow diverged at t = 0\.40: take more time steps"):
            plant.advance_to(2, 0.0)
    for other in (replace(start, substep=3), replace(start, substep=2, dt=0.05)):
        with pytest.raises(PlantError, match=f"at step {other.substep} of a clock with dt = {other.dt}, this plant"):
            OpenFoamWake(tmp_path / "case", other, FlowConfig(substeps=2), 0.5)
