"""Recording of drives: the ECU in Python closes the loop with the project's own wake on the coarse mesh."""

import tomllib
import zlib
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import cache
from math import inf
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, Final

from can_bridge.bus.interface import HEALTHY, BusHealth
from can_bridge.secoc.key import write_key
from can_bridge.secoc.securing import authentication_in_virtual_time
from can_bridge.wire.frame import Frame
from contract.config.loading import load_config
from contract.config.tree import Config
from contract.controller.calibration import Calibration
from contract.release.checks import Bundle
from contract.runtime.onnx_session import OnnxController
from contract.typed import typed
from ecu.ecu import Ecu
from ecu.ecu_state import EcuState
from ecu.stepped import CalibratedEcu, LoopEcu
from firmware_sim.bench.disturbances import Disturbances
from firmware_sim.bench.simulation import Simulation, Spans
from stillwake.parts.differentiable_wake import mesh_of
from stillwake.parts.releases import open_release
from tests.replay.shelf import Answers, Period, Recorded, save
from wake.plant.drive import Drive
from wake.plants import own_wake

PLANS: Final = Path(__file__).with_name("drives.toml")
KEY: Final = bytes(range(16))
"""The key of the secured drives. It is published and protects nothing."""
PHASES: Final = 5
"""Phases of a shedding cycle of 25 control periods at which drives begin, in turn."""


@dataclass(frozen=True, kw_only=True)
class Plan:
    """A table of `drives.toml`, which explains the attributes; `number` is the table's position."""

    name: str
    number: int
    sentence: str
    disturb: tuple[str, ...] = ()
    settings: tuple[str, ...] = ()
    speeds: tuple[tuple[float, float], ...] = ()
    calibrate: tuple[tuple[float, dict[str, float]], ...] = ()
    updating: tuple[float, float] = (inf, inf)
    lead_in: float = 1.32
    controlled: float = 0.68


def plans(sensors: Sequence[str]) -> list[Plan]:
    found = []
    for number, (name, table) in enumerate(tomllib.loads(PLANS.read_text(encoding="utf-8")).items()):
        texts = [text.format(s=sensors) for text in table.get("disturb", ())]
        sentence = table["sentence"].format(s=sensors)
        found.append(typed({**table, "name": name, "number": number, "sentence": sentence, "disturb": texts}, Plan))
    return found


@contextmanager
def vehicle(settings: Sequence[str]) -> Iterator[Config]:
    """Yield the settings of a drive's vehicle; its key file exists during the block."""
    with TemporaryDirectory() as folder:
        write_key(key := Path(folder, "key"), KEY)
        yield replace(load_config(None, [text.format(key=key) for text in settings]), mpc=shipped().manifest.mpc)


@cache
def shipped() -> Bundle:
    return open_release(None)


@cache
def _controller() -> OnnxController:
    return OnnxController.of(shipped())


def python_ecu(config: Config, kind: type[Ecu] = Ecu) -> Any:
    return kind(shipped(), _controller(), config, authentication=authentication_in_virtual_time(config.bus))


class Recorder(Ecu):
    """The ECU, which records its inputs and answers, and which is calibrated and flashed as the plan says."""

    def begin(self, plan: Plan) -> None:
        self.periods, self.answers = list[Period](), Answers()
        self._plan, self._waiting, self._powered_on = plan, list(plan.calibrate), False

    def restore(self, state: EcuState) -> None:
        """Restore a state, which the loop does only at power-on."""
        super().restore(state)
        self._powered_on = True

    def step(self, now_ns: int, frames: Sequence[Frame], health: BusHealth = HEALTHY, **around: Any) -> list[Frame]:
        packed, (begin, end) = b"", self._plan.updating
        while self._waiting and now_ns >= self._waiting[0][0] * 1e9:
            _, values = self._waiting.pop(0)
            self.calibrate(self._calibration_limits.changed(self.calibration, values))
            packed = self.calibration.pack()
        given: dict[str, Any] = {"now_ns": now_ns, "frames": tuple(frames), "health": health, "calibration": packed}
        updating = begin * 1e9 <= now_ns < end * 1e9
        self.periods.append(Period(**given, updating=updating, powered_on=self._powered_on))
        self._powered_on = False
        sent = super().step(now_ns, frames, health, updating=updating)
        self.answers.add(self, sent)
        return sent


def open_loop(ecu: CalibratedEcu, periods: Sequence[Period]) -> Answers:
    """Give an ECU that was just powered on another ECU's inputs; return its answers, and restore state and values."""
    power_on, own, answers = ecu.state, ecu.calibration, Answers()
    for one in periods:
        if one.powered_on:
            ecu.restore(replace(power_on, verifier=ecu.state.verifier, freshness=ecu.state.freshness))
        if one.calibration:
            ecu.calibrate(Calibration.unpack(one.calibration))
        answers.add(ecu, ecu.step(one.now_ns, one.frames, one.health, updating=one.updating))
    ecu.calibrate(own)
    ecu.restore(power_on)
    return answers


def record(start: Path, target: Path, plan: Plan) -> None:
    """Run a drive from a state of the flow, and write the ECU's inputs and answers to a file."""
    with vehicle(plan.settings) as config:
        coarse, point, drive = mesh_of(config), config.operating_point, None
        if plan.speeds:
            times, ratios = zip(*plan.speeds, strict=True)
            drive = Drive(name=plan.name, times=times, speeds=tuple(ratio * point.speed for ratio in ratios))
            coarse = replace(coarse, flow=drive.substeps(coarse.flow, point))
        wake = own_wake(coarse, start=start)
        for _ in range(plan.number % PHASES * PHASES):
            wake.advance(0.0)
        wake.reset(replace(wake.state(), substep=0, action=0.0))
        ecu = python_ecu(config, Recorder)
        ecu.begin(plan)
        lead_in, controlled = (seconds / point.convective_time for seconds in (plan.lead_in, plan.controlled))
        Simulation(
            shipped(),
            coarse,
            spans=Spans(lead_in=lead_in, controlled=controlled, settle=0.0, averages=False),
            ecu=LoopEcu(ecu=ecu, kind="python", computed_by=_controller().description),
            disturbances=Disturbances.parse(plan.disturb),
            seed=zlib.crc32(plan.name.encode()),
            drive=drive,
        ).run(wake)
    known = {name: getattr(plan, name) for name in ("name", "sentence", "settings")}
    answers = {"python": ecu.answers}
    save(target, Recorded(**known, digest=shipped().digest, periods=ecu.periods, answers=answers))
