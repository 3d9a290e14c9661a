"""The shared plant in its developed state, a plant that costs nothing, and what tests of recording and of
OpenFOAM share."""

import numpy as np
import numpy.typing as npt
import pytest

from contract import sensors
from contract.config.plant import FlowConfig
from contract.recording.dataset import Dataset
from wake.openfoam.mesh import Mesh, truck_mesh
from wake.plant.sample import Sample
from wake.recording import episode_job, recorder
from wake.truck.state import State, developed_state
from wake.truck.truck_wake import TruckWake


@pytest.fixture(scope="session", autouse=True)
def _kernels(shared_wake: TruckWake) -> None:
    """Compiled once."""


@pytest.fixture
def wake(shared_wake: TruckWake) -> TruckWake:
    """The plant in its shipped developed state."""
    shared_wake.reset(developed_state())
    return shared_wake


class Oscillator:
    """A plant of two numbers whose samples tell every state and action apart."""

    def __init__(self, config: object = None, *, body: object = None) -> None:
        self.config = FlowConfig()
        self._flat, self._step, self._action = np.array([1.0, 0.0]), 0, 0.0

    def reset(self, state: State) -> Sample:
        self._flat, self._step, self._action = state.flat[:2].copy(), state.substep, state.action
        return self.sample()

    def state(self) -> State:
        return State(flat=self._flat.copy(), substep=self._step, action=self._action)

    def advance(self, action: float) -> Sample:
        x, v = self._flat
        v += 0.2 * (action - np.sin(x))
        self._flat, self._step, self._action = np.array([x + 0.2 * v, v]), self._step + 1, action
        return self.sample()

    def sample(self) -> Sample:
        x, v = (float(value) for value in self._flat)
        return Sample(
            t=0.2 * self._step,
            Cp=x + v * np.arange(sensors.COUNT) / sensors.COUNT,
            Cd=x,
            Cl=v,
            Cd_slot_pressure=x * v,
            Cd_slot_viscous=x - v,
            Cd_momentum=-(self._action**2),
            jet_power=self._action * x,
            Uy_probe=v - x,
            action=self._action,
        )


@pytest.fixture
def cheap_plant(monkeypatch: pytest.MonkeyPatch) -> None:
    """The recorder's plant in this process is an `Oscillator`."""
    start = State(flat=np.array([1.0, 0.0]), substep=0, action=0.0)
    monkeypatch.setattr(recorder, "TruckWake", Oscillator)
    monkeypatch.setattr(episode_job, "developed_state", lambda: start)
    monkeypatch.setattr(episode_job, "versions", lambda *names: dict.fromkeys(names, "1"))


class Killed(BaseException):
    """Stands for a signal: not an Exception, so nothing may swallow it."""


def equal(a: Dataset, b: Dataset) -> bool:
    """Whether two recordings have the same episodes and samples."""
    return [x.name for x in a.episodes] == [y.name for y in b.episodes] and all(
        np.array_equal(x.series[name], y.series[name])
        for x, y in zip(a.episodes, b.episodes, strict=True)
        for name in x.series
    )


@pytest.fixture(scope="session")
def coarse_mesh() -> Mesh:
    return truck_mesh(0.5)


def field(values: npt.ArrayLike) -> bytes:
    """Numbers (m,) or vectors (m, 3) in m cells, as icoFoam writes them."""
    cells = np.asarray(values, dtype=np.float64)
    kind = "scalar" if cells.ndim == 1 else "vector"
    head = 'FoamFile\n{\n    format      binary;\n    arch        "LSB;label=32;scalar=64";\n}\n'
    head += f"internalField   nonuniform List<{kind}> \n{len(cells)}\n("
    return head.encode() + cells.tobytes() + b")\n;\nboundaryField\n{}\n\n\n// " + 73 * b"*" + b" //\n"
