"""A small release, a controller that records what it is asked, and a bench that feeds one ECU by hand."""

from collections.abc import Callable, Sequence
from itertools import count
from typing import Any, cast

import numpy as np
import pytest
from numpy.typing import ArrayLike

from can_bridge.secoc.securing import Authentication
from can_bridge.wire import codec
from can_bridge.wire.frame import Frame
from can_bridge.wire.message_specs import ECU_STATUS, JET_COMMAND
from can_bridge.wire.messages import EcuStatus, JetCommand
from contract.config.controller import MpcConfig
from contract.config.tree import Config
from contract.config.vehicle import EcuConfig
from contract.controller.interface import ControlStep
from contract.release.checks import Bundle
from contract.release.manifest import Manifest, Scaling
from contract.sensors import COUNT, TRUCK
from ecu.ecu import Ecu
from firmware_sim.bench.vehicle_node import VehicleNode

WINDOW, HORIZON = 4, 5
NAMES = ("upper_39", "lower_39", "base_0", "base_9")


class RecordingController:
    """Plans what it was told to and keeps its inputs."""

    def __init__(self, plan: Callable[[int], float] = lambda i: 0.01) -> None:
        self.plan = plan
        self.calls: list[tuple[np.ndarray, np.ndarray, np.ndarray]] = []
        self.settings: list[tuple[np.ndarray | None, float, float | None]] = []

    def control_step(self, window, plan, free, weights=None, speed=1.0, limit=None) -> ControlStep:
        self.calls.append((window.copy(), plan.copy(), free.copy()))
        self.settings.append((weights, speed, limit))
        # As the graph does: the shifted plan where it is committed, new actions elsewhere.
        new = np.array([self.plan(i) for i in range(len(plan))])
        shifted = np.append(plan[1:], plan[-1])
        forces, terms = np.full((len(plan), 2), 0.5), np.zeros(8)
        return ControlStep(plan=np.where(free > 0.5, new, shifted), forces=forces, terms=terms, cost=1.0)


class Answering:
    """A controller that returns what it is given, or raises it."""

    def __init__(self, answer: object) -> None:
        self.answer = answer

    def control_step(self, window, plan, free, weights=None, speed=1.0, limit=None) -> ControlStep:
        if isinstance(self.answer, BaseException):
            raise self.answer
        return cast(ControlStep, self.answer)


def answer_of(horizon: int = 4, **changes: Any) -> ControlStep:
    """A sound answer but for these parts of it."""
    sound: dict[str, Any] = {"plan": np.zeros(horizon), "forces": np.zeros((horizon, 2)), "terms": np.zeros(8)}
    return ControlStep(**{**sound, "cost": 0.0, **changes})


def numbered() -> RecordingController:
    """A controller none of whose actions comes twice soon, in steps of the wire."""
    numbers = count()
    return RecordingController(lambda i: 0.0016 * (next(numbers) % 40))


class ByHand(VehicleNode):
    """A vehicle whose pressures and speed are given, and whose clock stands still between its frames."""

    def __init__(self, config: Config, authentication: Authentication | None = None) -> None:
        super().__init__(NAMES, config, authentication=authentication)
        self.config, self.now_ns = config, 1_000_000

    def pressures(self, cp: ArrayLike, *, asks: bool, age_ns: int = 0) -> Frame:
        """A frame sent now; cp, (4,), in units of the dynamic pressure: NaN is an invalid one."""
        wall = np.zeros(COUNT)
        wall[TRUCK.indices(NAMES)] = cp
        return self.sample(wall, enable_request=asks, now_ns=self.now_ns, age_ns=age_ns)

    def at_speed(self, ratio: float | None, *, age_ns: int = 0, density: float | None = None) -> Frame:
        """A frame with the vehicle's speed, in design speeds."""
        self.stated_speed = None if ratio is None else ratio * self.operating_point.speed
        self.stated_density = density
        frame = self.speed_frame(now_ns=self.now_ns, age_ns=age_ns)
        assert frame is not None
        return frame


class Bench(ByHand):
    """One ECU, stepped period by period with frames made by hand. `status` is its last one."""

    status: EcuStatus

    def __init__(self, bundle: Bundle, config: Config, controller) -> None:
        super().__init__(config)
        self.bundle, self.controller = bundle, controller
        self.ecu = Ecu(bundle, controller, config)
        # Of the vehicle, with every step; None for one that sends no speed.
        self.cruises = None if bundle.manifest.speeds is None else 1.0

    def pressure(self, cp=(0.1, 0.2, 0.3, 0.4), *, enable=True, age_ns=0) -> Frame:
        """The request is raised in the second frame of all."""
        return self.pressures(cp, asks=enable and self.frames_sent > 0, age_ns=age_ns)

    def step(self, *frames: Frame, periods: int = 1) -> JetCommand:
        """One step with these frames; the clock then moves on by `periods`."""
        speed = [] if self.cruises is None else [self.at_speed(self.cruises)]
        answers = self.ecu.step(self.now_ns, [*frames, *speed])
        self.now_ns += periods * self.config.period_ns
        assert [frame.frame_id for frame in answers] == [JET_COMMAND.frame_id, ECU_STATUS.frame_id]
        command, status = codec.parse_jet_command(answers[0].data), codec.parse_ecu_status(answers[1].data)
        assert command is not None and status is not None
        self.status = status
        return command

    def good(self, steps: int, *, enable=True) -> list[JetCommand]:
        return [self.step(self.pressure(enable=enable)) for _ in range(steps)]

    def into_control(self) -> JetCommand:
        """Enough frames for the stream to be trusted and the window to be full."""
        return self.good(WINDOW + 1)[-1]


def make_bundle(*, sensors: Sequence[str] = NAMES, **changes) -> Bundle:
    """A release of a few periods' window and horizon; there is no model in it."""
    config, zeros, ones = Config(), (0.0,) * len(sensors), (1.0,) * len(sensors)
    scaling = Scaling(
        pressure_mean=zeros, pressure_std=ones, action_std=1.0, force_mean=(1.0, 0.0), force_std=(1.0, 1.0)
    )
    facts = {
        **{"name": "small", "precision": "float32", "sensors": tuple(sensors), "window": WINDOW, "scaling": scaling},
        **{"control_period": config.flow.control_period, "action_limit": config.flow.action_limit},
        **{"operating_point": config.operating_point, "mpc": MpcConfig(horizon=HORIZON)},
        **{"budget_ms": 20.0, "compute_time_ms": 8.0, "created": "2026-01-02", "provenance": {}},
        **dict.fromkeys(("dataset_sha256", "weights_sha256", "program_sha256"), "0" * 64),
    }
    return Bundle(manifest=Manifest(**{**facts, **changes}), files={}, digest="0123456789abcdef" * 4)


def make_bench(controller=None, *, bundle: Bundle | None = None, **ecu_settings) -> Bench:
    # Most tests look at one period at a time: its command is to act in it.
    config = Config(ecu=EcuConfig(**{"plan_ahead": False, **ecu_settings}))
    return Bench(make_bundle() if bundle is None else bundle, config, controller or RecordingController())


@pytest.fixture
def bench() -> Bench:
    return make_bench()
