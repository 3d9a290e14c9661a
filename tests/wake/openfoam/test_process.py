"""icoFoam that is missing, crashes, hangs or must be ended: always one error, never a wait without end or an orphan.

A script stands for icoFoam: it reads the pipes in the same order.

A flow that diverges is refused by the step that finds it, also if nobody samples afterwards.

A script stands for icoFoam: it takes the jets' velocities and writes measurements, which diverge at some step.
"""

import json
import os
import re
import struct
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

from contract.config.plant import FlowConfig
from contract.errors import PlantError
from wake.openfoam import wall
from wake.openfoam.measurements import Readings
from wake.openfoam.plant import OpenFoamWake
from wake.openfoam.process import IcoFoam, JetPipes
from wake.openfoam.state import FoamState
from wake.openfoam.wall import pressure_points

READER = """
import sys, time
upper, lower, steps, after = sys.argv[1:]
for step in range(int(steps)):
    for path in (upper, lower):
        with open(path) as file:
            print(path, file.read().split(), flush=True)
print("something went wrong", flush=True)
exec(after)
"""


@pytest.fixture
def case(coarse_mesh, tmp_path) -> Path:
    wall.write_pipes(tmp_path, coarse_mesh, dt=0.01, steps=10, action=0.0)
    return tmp_path


def _reader(case: Path, steps: int, after: str) -> IcoFoam:
    pipes = [str(wall.pipe(case, jet)) for jet in wall.JETS]
    return IcoFoam(case, (sys.executable, "-c", READER, *pipes, str(steps), after))


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
        IcoFoam(tmp_path, ("icoFoam-that-is-not-there",))
    assert "\n" not in str(caught.value) and not list(tmp_path.iterdir())


def test_steps_reach_the_program_upper_jet_first(case, coarse_mesh):
    with _reader(case, 2, "raise SystemExit(0)") as child, JetPipes(case, coarse_mesh, child, patience_s=30.0) as pipes:
        pipes.send(0.05)
        pipes.send(-0.02)
        assert child.wait(30.0)
    lines = (case / "log.icoFoam").read_text().splitlines()[:4]
    assert [Path(line.split()[0]).parent.name for line in lines] == ["jetUpper", "jetLower"] * 2
    # Two equal faces a slot here: each carries half the flow over half the width.
    speeds = [[float(number) for number in re.findall(r"'\(([-\d.]+)'", line)] for line in lines]
    assert speeds == [pytest.approx([speed] * 2) for speed in (1.0, -1.0, -0.4, 0.4)]


@pytest.mark.parametrize(
    ("after", "what"),
    [
        ("raise SystemExit(3)", "stopped with status 3"),
        ("import os, signal; os.kill(os.getpid(), signal.SIGFPE)", "ended by SIGFPE"),
        ("raise SystemExit(0)", "reached its end"),
        ("time.sleep(600)", r"has not finished a time step in 0\.5 s"),
    ],
)
def test_a_program_that_fails_is_one_error_with_its_last_words(case, coarse_mesh, after, what):
    with _reader(case, 1, after) as child, JetPipes(case, coarse_mesh, child, patience_s=30.0) as pipes:
        pipes.send(0.0)
        pipes._patience_s = 0.5 if "sleep" in after else 30.0
        with pytest.raises(PlantError, match=f"{what}.*something went wrong") as caught:
            pipes.wait()
        assert "\n" not in str(caught.value)
    assert not child.running


def test_a_program_that_does_not_listen_is_ended_by_force(tmp_path, monkeypatch):
    monkeypatch.setattr("wake.openfoam.process._GRACE_S", 0.2)
    deaf = (
        "import signal, time; signal.signal(signal.SIGTERM, signal.SIG_IGN); print('deaf', flush=True); time.sleep(600)"
    )
    child = IcoFoam(tmp_path, (sys.executable, "-c", deaf))
    while "deaf" not in (tmp_path / "log.icoFoam").read_text():
        assert child.running
        time.sleep(0.01)
    child.stop()
    assert not child.running


PARENT = """
import sys, time
from pathlib import Path
from wake.openfoam.process import IcoFoam
with IcoFoam(Path(sys.argv[1]), ("sleep", "600")) as child:
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


# Every file has a row for good steps and one for bad ones.
SOLVER = """#!{python}
import json, pathlib
rows = json.loads('''{rows}''')
for step in range(1, 100):
    for jet in ("jetUpper", "jetLower"):
        pathlib.Path("pipes", jet, "U").read_text()
    for name, (good, bad) in rows.items():
        path = pathlib.Path("postProcessing", name)
        path.parent.mkdir(parents=True, exist_ok=True)
        with path.open("a") as file:
            print(step, bad if step >= {bad_from} else good, file=file)
"""

FORCES = ("forcesTruck", "forcesJetUpper", "forcesJetLower")


def _field(values: np.ndarray, kind: str) -> bytes:
    head = f'arch "LSB;label=32;scalar=64";\ninternalField nonuniform List<{kind}>\n{len(values)}\n('
    return head.encode() + struct.pack(f"<{values.size}d", *values.ravel()) + b")\n;\n"


def _start(cells: int, probes: int) -> FoamState:
    files = {"U": _field(np.ones((cells, 3)), "vector"), "p": _field(np.ones(cells), "scalar")}
    return FoamState(
        files={**files, "phi": b"", "U_0": b"", "phi_0": b""},
        dt=0.1,
        readings=Readings(forces=np.ones((3, 3, 3)), pressures=np.ones(probes), wake=np.ones(3)),
        action=0.0,
        substep=0,
    )


def _install(folder: Path, probes: int, broken: str, bad_from: int) -> None:
    """Make the program; from some step on, the measurement named `broken` holds a `-nan`."""
    rows = {f"{name}/0/force.dat": "(1 1 0) (1 1 0) (1 1 0)" for name in FORCES}
    rows |= {"wallPressures/0/p": " ".join(["1"] * probes), "wakeProbe/0/U": "(1 1 0)"}
    both = {name: (row, row.replace("1", "-nan", 1) if broken in name else row) for name, row in rows.items()}
    folder.mkdir()
    program = folder / "icoFoam"
    program.write_text(SOLVER.format(python=sys.executable, rows=json.dumps(both), bad_from=bad_from))
    program.chmod(0o755)


@pytest.mark.parametrize("broken", ["forcesJetLower", "wallPressures"])
def test_divergence_in_the_last_step_is_refused_by_that_step(coarse_mesh, tmp_path, monkeypatch, broken):
    probes = len(pressure_points(coarse_mesh))
    start = _start(len(coarse_mesh.cells), probes)
    _install(tmp_path / "bin", probes, broken, bad_from=4)
    monkeypatch.setenv("PATH", str(tmp_path / "bin"), prepend=os.pathsep)
    with OpenFoamWake(tmp_path / "case", start, FlowConfig(substeps=2), 0.5, duration=0.4, patience_s=30.0) as plant:
        plant.advance(0.05)
        plant.advance_to(1, 0.0)
        assert plant.sample().t == pytest.approx(0.3)
        with pytest.raises(PlantError, match=r"the flow diverged at t = 0\.40: take more time steps"):
            plant.advance_to(2, 0.0)
