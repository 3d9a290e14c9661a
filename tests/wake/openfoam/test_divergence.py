"""A flow that diverges is refused by the step that finds it, also if nobody samples afterwards.

A script stands for icoFoam: it takes the jets' velocities and writes measurements, which diverge at some step.
"""

import json
import os
import struct
import sys
from pathlib import Path

import numpy as np
import pytest

from contract.config.plant import FlowConfig
from contract.errors import PlantError
from wake.openfoam.measurements import Readings
from wake.openfoam.plant import OpenFoamWake
from wake.openfoam.state import FoamState
from wake.openfoam.wall import pressure_points

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


@pytest.mark.parametrize("broken", ["forcesTruck", "forcesJetLower", "wallPressures", "wakeProbe"])
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
