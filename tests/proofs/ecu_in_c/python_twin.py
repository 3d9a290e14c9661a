"""The Python ECU, with networks whose answers are given, and its periods as C is to live through them."""

from dataclasses import dataclass, field
from typing import Any

import numpy as np
import pytest

from can_bridge.bus.interface import HEALTHY, BusHealth
from can_bridge.wire.frame import Frame
from can_bridge.wire.message_sets import message_set
from can_bridge.wire.messages import Reason
from contract.arrays import Array
from contract.config.tree import Config
from contract.controller.calibration import CALIBRATION_NAMES, Calibration
from contract.controller.estimator import Hypotheses
from contract.controller.interface import FORCES, TERMS, ControllerError, ControlStep
from contract.errors import ConfigError
from ecu.calibrating import limits_of
from ecu.ecu import Ecu
from ecu.ecu_state import EcuState
from ecu.in_c.c_structs import c_time, fill_frame
from ecu.sensor_check import SensorCheck
from tests.proofs.ecu_in_c.library import Layout
from tests.proofs.ecu_in_c.variants import AUTHENTICATION, bundle_of

HYPOTHESES = Hypotheses.of(4)


@dataclass(frozen=True, kw_only=True, eq=False)
class Answers:
    """What the networks answer in one period, if they are asked. Plan and forces may be NaN or infinite."""

    plan: Array  # (H,), in float32
    forces: Array  # (H, 2), in float32
    estimates: Array  # (V, S)
    is_planned: bool = True  # whether the control step has an answer


@dataclass(frozen=True, kw_only=True, eq=False)
class Period:
    """What comes to an ECU in one control period, from outside and from its networks, and what is done before it."""

    now_ns: int
    frames: list[Frame]
    answers: Answers
    health: BusHealth = HEALTHY
    fault: Reason | None = None
    updating: bool = False
    restarts: bool = False
    loads: EcuState | None = None
    calibration: Calibration | None = None  # within the limits or not


@dataclass
class Networks:
    """Controller and estimator: they answer what was prepared, and keep what they were asked."""

    answers: Answers
    planned_on: list[tuple[Array, ...]] = field(default_factory=list)
    estimated_on: list[Array] = field(default_factory=list)

    def prepare(self, answers: Answers) -> None:
        self.answers = answers
        self.planned_on.clear()
        self.estimated_on.clear()

    def control_step(
        self, window: Array, plan: Array, free: Array, weights: Any = None, speed: float = 1.0, limit: Any = None
    ) -> ControlStep:
        assert weights is not None and limit is not None
        self.planned_on.append((window, plan, free, weights, np.array([speed, limit])))
        if not self.answers.is_planned:
            raise ControllerError("no answer")
        return ControlStep(plan=self.answers.plan, forces=self.answers.forces, terms=np.zeros(len(TERMS)), cost=0.0)

    def estimates(self, window: Array) -> Array:
        self.estimated_on.append(window.copy())
        return self.answers.estimates


class PythonTwin:
    def __init__(self, config: Config, layout: Layout) -> None:
        bundle = bundle_of(config)
        self.horizon, self.window = bundle.manifest.mpc.horizon, bundle.manifest.window
        self.config, self.layout = config, layout
        self._pressure_id = message_set(config.bus).pressure.spec.frame_id
        plan, forces = np.zeros(self.horizon), np.zeros((self.horizon, FORCES))
        self.networks = Networks(Answers(plan=plan, forces=forces, estimates=np.zeros((34, 4))))
        self.ecu = Ecu(bundle, self.networks, config, authentication=AUTHENTICATION if config.bus.key else None)
        figures = bundle.manifest.sensor_estimator
        if config.ecu.sensor_check.enabled and figures is not None:
            # The bundle has figures and no graph: what answers in its place is here.
            self.ecu._sensor_check = SensorCheck.of(figures, self.networks, config.ecu.sensor_check)
        self.power_on, self._own, self.limits = self.ecu.state, self.ecu.calibration, limits_of(bundle, config)

    def live_through(self, period: Period, place: Any) -> None:
        """One period: the stimulus as it comes to C, and the response that is expected of it, into a `twin_period`."""
        self._tell(period, place.stimulus)
        if period.restarts:
            self.ecu.calibrate(self._own)
            self.ecu.restore(self.power_on)
        if period.loads is not None:
            self.ecu.restore(period.loads)
        place.response.refused = 0 if period.calibration is None else self._calibrate(period.calibration)
        ffi = self.layout.ffi
        ffi.buffer(ffi.addressof(place.response, "calibration"))[:] = self.ecu.calibration.pack()
        self.networks.prepare(period.answers)
        sent = self.ecu.step(period.now_ns, period.frames, period.health, fault=period.fault, updating=period.updating)
        self._expect(sent, place.response)

    def _calibrate(self, values: Calibration) -> int:
        """The number of the first value that is refused; 0 if all are taken."""
        rows = zip(values.values, self.limits.least.values, self.limits.greatest.values, strict=True)
        beyond = (number for number, (value, low, high) in enumerate(rows, 1) if not low <= value <= high)
        if (first := next(beyond, 0)) == 0:
            self.ecu.calibrate(values)
        else:
            with pytest.raises(ConfigError, match=CALIBRATION_NAMES[first - 1]):
                self.ecu.calibrate(values)
        return first

    def _tell(self, period: Period, place: Any) -> None:
        structs, ffi, answers = self.layout.structs, self.layout.ffi, period.answers
        place.now_ns, place.loads = c_time(period.now_ns), period.loads is not None
        place.restarts, place.calibrates = period.restarts, period.calibration is not None
        if period.calibration is not None:
            ffi.buffer(ffi.addressof(place, "calibration"))[:] = period.calibration.pack()
        structs.surround(place.surroundings, period.health, fault=period.fault, updating=period.updating)
        place.count = len(period.frames)
        for item, frame in zip(place.frames, period.frames, strict=False):
            fill_frame(item, frame)
        for item in (place.not_first, place.frames[len(period.frames)]):
            item.id = self._pressure_id
        given = place.answers
        given.is_planned = answers.is_planned
        structs.copy(given.plan, answers.plan.astype(np.float32))
        structs.copy(given.forces, answers.forces.astype(np.float32))
        structs.copy(given.estimates, answers.estimates[HYPOTHESES.view, np.arange(4)])
        if period.restarts or period.loads is not None:
            structs.set_state(ffi.addressof(place, "before"), period.loads or self.power_on)

    def _expect(self, sent: list[Frame], place: Any) -> None:
        structs, trace, networks = self.layout.structs, self.ecu.trace, self.networks
        place.sent = len(sent)
        for item, frame in zip(place.frames, sent, strict=False):
            fill_frame(item, frame)
        place.trace.action, place.trace.planned = trace.action, trace.forces is not None
        place.trace.interventions = trace.interventions.value
        structs.set_state(structs.ffi.addressof(place, "state"), self.ecu.state)
        place.plans_asked, place.estimates_asked = len(networks.planned_on), len(networks.estimated_on)
        for window, plan, free, weights, (speed, limit) in networks.planned_on:
            asked = place.planned_on
            for member, values in ((asked.window, window), (asked.plan, plan), (asked.free, free)):
                structs.copy(member, values.astype(np.float32))
            structs.copy(asked.weights, weights.astype(np.float32))
            asked.speed, asked.limit = float(speed), float(limit)
        for window in networks.estimated_on:
            structs.copy(place.estimated_on, window)
