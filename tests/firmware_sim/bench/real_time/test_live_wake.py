"""The own solver in a process of its own."""

import os
import signal
import time
from pathlib import Path

import numpy as np
import pytest

from contract.config.plant import FlowConfig
from contract.config.tree import Config
from contract.errors import PlantError
from firmware_sim.bench.real_time.live_wake import LiveWake
from tests.conftest import Coarse

pytestmark = pytest.mark.processes  # each starts one, which loads the solver

COARSE = Config(flow=FlowConfig(refinement=0.4, substeps=12))
ACTIONS = (0.0, 0.03, 0.075, -0.075, 0.02)


@pytest.fixture
def start(coarse: Coarse) -> Path:
    return Path(coarse.words[coarse.words.index("--state") + 1])


def next_pressures(live: LiveWake) -> np.ndarray:
    deadline = time.monotonic() + 60.0
    while (cp := live.sampled()) is None:
        assert time.monotonic() < deadline
        time.sleep(0.001)
    return cp


def test_it_is_the_solver_to_the_bit_whatever_stops_reach_its_group(coarse: Coarse, start: Path) -> None:
    with coarse.plant() as wake:
        # One period passes at the start, which compiles.
        expected = [wake.advance(action).Cp for action in (0.0, *ACTIONS, 0.01)]
    with LiveWake(COARSE, start) as live:
        process = live._process
        found = [next_pressures(live)]
        assert np.array_equal(next_pressures(live), found[0])
        for action in ACTIONS:
            live.drive(action)
            found.append(next_pressures(live))
            # A stop of the whole group leaves its end to the vehicle.
            for number in (signal.SIGINT, signal.SIGTERM):
                os.kill(process.pid or 0, number)
        assert "177 x 66 cells" in live.description
        assert 0.0 < live.speed.typical_ms <= live.speed.worst_ms
        # A period that is being computed has no pressures, and to drive it then changes nothing.
        os.kill(process.pid or 0, signal.SIGSTOP)
        live.drive(0.01)
        assert live.sampled() is None
        live.drive(0.05)
        os.kill(process.pid or 0, signal.SIGCONT)
        found.append(next_pressures(live))
    assert process.exitcode == 0
    assert all(np.array_equal(one, other) for one, other in zip(found, expected, strict=True))


@pytest.mark.proofs  # starts the wake's process three times
def test_a_process_that_dies_or_fails_is_an_error_here(start: Path, tmp_path: Path) -> None:
    with pytest.raises(PlantError, match="not a flow state"):
        LiveWake(COARSE, tmp_path / "missing.npz")
    with LiveWake(COARSE, start) as live:
        live._process.kill()
        live._process.join()
        with pytest.raises(PlantError, match="the live wake's process ended"):
            for _ in range(2):
                live.drive(0.0)
                live.sampled()
