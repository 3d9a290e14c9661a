"""Another goal in flight, in the closed loop: from one control period on, whole, and kept by the jets."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest

from can_bridge.bus.interface import HEALTHY, BusHealth
from can_bridge.calibration.segment import Segment
from can_bridge.wire.frame import Frame
from can_bridge.wire.message_specs import FLOW_RESOLUTION_M2_PER_S
from can_bridge.wire.messages import EcuStatus, Mode
from contract.config.operating_point import OperatingPoint
from contract.controller.calibration import Calibration
from contract.controller.interface import ControlStep
from firmware_sim.ecu.calibrating import limits_of, release_calibration
from firmware_sim.ecu.ecu import Ecu, Trace
from firmware_sim.ecu.ecu_state import EcuState
from tests.firmware_sim.bench.harness import WARM, Harness

HORIZON = 5
QUANTUM = FLOW_RESOLUTION_M2_PER_S / OperatingPoint().flow_rate_scale
LIMIT = 0.075


class Weighing:
    """Its action shows the weight that it was given and the pressure that it saw."""

    def __init__(self) -> None:
        self.wanted: list[tuple[float, float]] = []

    def control_step(self, window, plan, free, weights=None) -> ControlStep:
        pressure = float(window[-1, 0])
        self.wanted.append((weights[2], weights[2] * pressure))
        new = np.full(HORIZON, weights[2] * pressure)
        return ControlStep(plan=new, forces=np.zeros((HORIZON, 2)), terms=np.zeros(7), cost=0.0)


class CalibratedEcu:
    """An ECU that takes its segment over between two steps."""

    segment: Segment

    def __init__(self, ecu: Ecu) -> None:
        self.ecu = ecu

    @property
    def state(self) -> EcuState:
        return self.ecu.state

    @property
    def trace(self) -> Trace:
        return self.ecu.trace

    @property
    def frames_rejected(self) -> int:
        return self.ecu.frames_rejected

    def restore(self, state: EcuState) -> None:
        self.ecu.restore(state)

    def step(self, now_ns: int, frames: Sequence[Frame], health: BusHealth = HEALTHY) -> list[Frame]:
        if (calibration := self.segment.take()) is not None:
            self.ecu.calibrate(calibration)
        return self.ecu.step(now_ns, frames, health)

    def status(self) -> EcuStatus:
        return self.ecu.status()


@pytest.fixture
def loop_of(harness, bundle_of):
    """A loop whose oscillator swings beyond the jets, and the segment of its ECU."""

    def make() -> tuple[Harness, Segment, Weighing]:
        controller, ecus = Weighing(), []

        def around(ecu: Ecu) -> CalibratedEcu:
            ecus.append(CalibratedEcu(ecu))
            return ecus[0]

        h, bundle = harness(8.0, controller=controller, around=around), bundle_of()
        ecus[0].segment = segment = Segment(release_calibration(bundle, h.config), limits_of(bundle, h.config))
        return h, segment, controller

    return make


def changed(segment: Segment, *, lift: float, action_limit: float) -> Calibration:
    own = segment.reference
    return replace(own, weights=replace(own.weights, lift=lift), action_limit=action_limit)


def test_a_goal_changes_with_one_period_and_the_jets_keep_it(loop_of):
    h, segment, controller = loop_of()
    rows = h.run(WARM + 20)
    segment.set(changed(segment, lift=0.5, action_limit=LIMIT / 2))
    rows += h.run(40)
    segment.revert()
    rows += h.run(20)
    weights = [weight for weight, _ in controller.wanted]
    first = len(rows) - 60
    planned = len(rows) - len(weights)
    changes = [planned + k for k in range(1, len(weights)) if weights[k] != weights[k - 1]]
    assert changes == [first, first + 40]
    commands = np.array([row.command for row in rows])
    wanted = np.array([action for _, action in controller.wanted])
    limit = np.full(len(rows), LIMIT)
    limit[first : first + 40] = LIMIT / 2
    assert np.all(np.abs(commands) <= limit)
    # The bound and the weight changed with the same command, and each was really met. The wire rounds, and the range
    # ends on a step of it.
    within = np.clip(wanted, -limit[planned:], limit[planned:])
    np.testing.assert_allclose(commands[planned:], within, atol=2 * QUANTUM)
    assert np.abs(commands[first : first + 40]).max() == pytest.approx(LIMIT / 2, abs=2 * QUANTUM)
    assert np.abs(commands[planned:first]).max() < 0.8 * LIMIT
    # The plant's jets follow the commands.
    assert h.targets()[planned:] == commands[planned:].tolist()
    assert {row.mode for row in rows[WARM:]} == {Mode.CONTROL}


def test_the_releases_own_values_written_in_flight_change_nothing(loop_of):
    (h, segment, _), (plain, _, _) = loop_of(), loop_of()
    rows = h.run(20)
    segment.set(Calibration.unpack(segment.reference.pack()))
    rows += h.run(20)
    assert [row.command for row in rows] == [row.command for row in plain.run(40)]
    assert h.captured == plain.captured
