"""The own solver in a process of its own, and whether it keeps up."""

import os
import signal
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from contract.config.plant import FlowConfig
from contract.config.tree import Config
from contract.errors import PlantError
from firmware_sim.bench.real_time.live_wake import LiveWake, Speed
from tests.conftest import Coarse
from wake.truck.state import State
from wake.truck.truck_wake import TruckWake

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


@pytest.mark.processes  # loads the solver
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


@pytest.mark.processes
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


def test_a_wake_that_does_not_keep_up_is_refused_with_the_remedy_and_one_that_only_just_does_is_warned_of() -> None:
    coarse: dict[str, Any] = {"refinement": 0.75, "substeps": 15}
    assert Speed(10.0, 11.0).check(20.0, **coarse) is None
    for times in ((19.0, 19.5), (10.0, 25.0)):
        assert "periods without pressures are to be expected" in str(Speed(*times).check(20.0, **coarse)), times
    with pytest.raises(
        PlantError,
        match=r"takes 72\.0 ms for a control period of 20 ms .*refinement = 1, flow\.substeps = 30.*: it cannot keep up"
        r"\. .*--set flow\.refinement=0\.75 --set flow\.substeps=15\), or divide operating_point\.speed by 4",
    ):
        Speed(72.0, 90.0).check(20.0, refinement=1.0, substeps=30)
    # The advice is no grid that is in use already; and what it names would do.
    with pytest.raises(PlantError, match=r"longer steps, or divide operating_point\.speed by 1\.7") as caught:
        Speed(30.0, 30.0).check(20.0, **coarse)
    assert "refinement=" not in str(caught.value)
    assert Speed(30.0, 30.0).check(1.7 * 20.0, **coarse) is None


def test_the_measurement_leaves_the_wake_as_it_was() -> None:
    wake = TruckWake(FlowConfig(refinement=0.4, substeps=12))
    wake.reset(State(flat=wake.solver.start().flat, substep=0, action=0.0))
    wake.solver.run(wake.flow, dt=1e-4, steps=200, action_from=0.0, action_to=0.0)
    begin = wake.state()
    ticks = iter([0.0, 0.011, 1.0, 1.013])
    assert Speed.of(wake, 2, lambda: next(ticks)) == pytest.approx((12.0, 13.0))
    assert (wake.state().flat == begin.flat).all()
    assert wake.t == 0.0
