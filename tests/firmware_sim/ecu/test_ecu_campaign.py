"""Thousands of random periods on a bad bus, with a bad clock and a bad controller: what must hold in each of them.

What was sent is judged by frames that the campaign made itself and their times; of the ECU nothing is read but what it
sends. Without chance there would be no such sequence; with one seed it is the same in every run.
"""

import random
from collections import Counter
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import pytest

from can_bridge.bus.interface import HEALTHY, BusHealth, BusState
from can_bridge.e2e import profile5
from can_bridge.e2e.sender import SenderState
from can_bridge.wire import codec
from can_bridge.wire.frame import Frame
from can_bridge.wire.message_specs import ECU_STATUS, FLOW_RESOLUTION_M2_PER_S, JET_COMMAND
from can_bridge.wire.messages import JetCommand, Mode, Reason
from contract.config.tree import Config
from contract.config.vehicle import EcuConfig
from contract.controller.interface import ControllerError, ControlStep

CONFIG = Config(ecu=EcuConfig(plan_ahead=False))
PERIOD = CONFIG.period_ns
SCALE = CONFIG.operating_point.flow_rate_scale
QUANTUM = FLOW_RESOLUTION_M2_PER_S
LIMIT = CONFIG.flow.action_limit * SCALE
STEP = CONFIG.ecu.command_step * SCALE
FRESH_NS, HELD_NS = 30_000_000, 80_000_000
"""A period and a half; the frame's own period, one of hold and two of decay."""
DRIVING = (Mode.CONTROL, Mode.HOLD, Mode.DECAY)


class Hostile:
    """Mostly a controller; from time to time anything else."""

    def __init__(self, rng: random.Random) -> None:
        self.rng = rng

    def control_step(self, window, plan, free, weights=None) -> ControlStep:
        kind, horizon = self.rng.random(), len(plan)
        values = np.array([self.rng.uniform(-0.15, 0.15) for _ in range(horizon)])
        forces = np.zeros((horizon, 2))
        if kind < 0.004:
            raise self.rng.choice([ControllerError("x"), ValueError("x"), MemoryError(), ZeroDivisionError()])
        if kind < 0.008:
            wrong: list[Any] = [
                None,
                values[:2],
                values.astype(object),
                np.zeros((horizon, 2)),
                np.full(horizon, 1e307),
            ]
            values = self.rng.choice(wrong)
        elif kind < 0.012:
            values[self.rng.randrange(horizon)] = self.rng.choice([np.nan, np.inf, -np.inf])
        elif kind < 0.014:
            forces = np.full((horizon, 2), np.nan)
        plan[:] = 7.0
        return ControlStep(plan=values, forces=forces, terms=np.zeros(7), cost=0.0)


@dataclass
class Made:
    """What the campaign knows of a frame it made: sampled when, usable, and the wish in it."""

    sampled_ns: int
    usable: bool
    wish: bool
    counter: int


@dataclass
class Campaign:
    """One ECU through `periods` random periods; `seen` counts what it did."""

    bench: Any
    rng: random.Random
    calm: float
    burst: str = ""
    seen: Counter = field(default_factory=Counter)

    def run(self, periods: int) -> Counter:
        bench, made, wish = self.bench, dict[bytes, Made](), True
        bench.now_ns = 10**12
        used: Made | None = None  # behind the command
        before = JetCommand(flow_m2_per_s=0.0, mode=Mode.OFF, enable=False, pressure_counter=None)
        before_ns: int | None = None
        kept: list[Frame] = []
        health, bus_off = HEALTHY, 0
        for k in range(periods):
            wish = wish if self.rng.random() < (0.99 if before.mode is Mode.CONTROL else 0.85) else not wish
            frames = self.frames(wish, made, kept)
            if self.rng.random() < 0.001:
                bus_off += 1
                health = BusHealth(state=BusState.BUS_OFF, bus_off=bus_off)
            elif self.rng.random() < 0.3:
                health = BusHealth(bus_off=bus_off)
            now_ns = bench.now_ns
            answers = bench.ecu.step(now_ns, frames, health)
            command, status = self.parsed(answers, k)
            arrived = [made[frame.data] for frame in frames if frame.data in made]
            candidates = [item for item in arrived if item.usable and 0 <= now_ns - item.sampled_ns <= FRESH_NS]
            self.judge(command, before, now_ns, before_ns, status, candidates, used)
            if command.pressure_counter is not None:
                named = [item for item in candidates if item.counter == command.pressure_counter]
                if named:
                    used = named[-1]
                assert used is not None
                assert command.pressure_counter == used.counter
            if health.state is BusState.BUS_OFF:
                assert not command.enable
            self.seen[command.mode, status.reason] += 1
            before, before_ns = command, now_ns
            self.pass_time()
        return self.seen

    def frames(self, wish: bool, made: dict[bytes, Made], kept: list[Frame]) -> list[Frame]:
        """What arrives in a period: mostly one good frame."""
        bench, rng = self.bench, self.rng
        if not self.burst and rng.random() < 0.01:
            self.burst = rng.choice("xciA") * rng.randrange(2, 7)
        kinds = rng.choices("Gxcdiaqrj2", [self.calm, 4, 1, 1, 2, 1, 1, 1, 0.3, 2])[0]
        if self.burst:
            kinds, self.burst = self.burst[0], self.burst[1:]
        if kinds == "x":
            return []
        found = []
        for kind in "GG" if kinds == "2" else kinds:
            if kind == "r" and kept:
                found.append(rng.choice(kept))
                continue
            if kind == "j":
                bench.sender.state = SenderState(counter=rng.randrange(256))
            age_ns = rng.choice([10_000_000, 35_000_000, 90_000_000]) if kind in "aq" else 90_000_000 * (kind == "A")
            valid = (kind != "i",) * 4
            frame = bench.pressure(enable=wish, valid=valid, age_ns=age_ns if kind in "aA" else 0)
            if kind == "q":
                frame = replace(frame, timestamp_ns=bench.now_ns - age_ns)
            if kind == "c":
                data = bytearray(frame.data)
                data[rng.randrange(len(data))] ^= 1 << rng.randrange(8)
                frame = replace(frame, data=bytes(data))
            elif kind == "d":
                frame = replace(frame, data=frame.data[:8])
            else:
                counter = profile5.counter_of(frame.data)
                made[frame.data] = Made(bench.now_ns - age_ns, kind != "i", wish, counter)
                kept[:] = [*kept[-5:], frame]
            found.append(frame)
        return found

    def pass_time(self) -> None:
        """Mostly a period; jitter, skipped periods and a clock that is set."""
        rng, kind = self.rng, self.rng.random()
        elapsed = PERIOD + round(rng.gauss(0.0, 0.02) * PERIOD)
        if kind < 0.002:
            elapsed = rng.choice([0, -1, -200_000_000, -(10**10), 10**9, 10**13])
        elif kind < 0.01:
            elapsed = rng.choice([1_000_000, 9_000_000, 29_900_000, 40_000_000, 60_000_000])
        self.bench.now_ns += elapsed

    def parsed(self, answers: list[Frame], k: int):
        """Two sound frames, numbered without a gap."""
        for frame, spec in zip(answers, (JET_COMMAND, ECU_STATUS), strict=True):
            assert frame.frame_id == spec.frame_id
            assert profile5.check(frame.data, data_id=spec.data_id)
            assert profile5.counter_of(frame.data) == k % 256
        command, status = codec.parse_jet_command(answers[0].data), codec.parse_ecu_status(answers[1].data)
        assert command is not None
        assert status is not None
        assert status.state is command.mode
        return command, status

    def judge(self, command, before, now_ns, before_ns, status, candidates, used) -> None:
        """The promises about the jets, whatever came."""
        flow, mode = command.flow_m2_per_s, command.mode
        assert abs(flow) <= LIMIT + 1e-9
        if not command.enable:
            assert flow == 0.0
        if command.enable:
            assert mode in DRIVING
        elif mode in DRIVING:
            assert status.reason in (Reason.STALE, Reason.CLOCK, Reason.INTERNAL)
        assert (mode is Mode.FAULT) <= (status.reason is not Reason.NONE)
        assert (mode in (Mode.OFF, Mode.CONTROL)) <= (status.reason is Reason.NONE)
        elapsed = PERIOD if before_ns is None else now_ns - before_ns
        if flow != 0.0:
            assert elapsed > 0
            assert abs(flow - before.flow_m2_per_s) <= STEP * min(1.0, elapsed / PERIOD) + QUANTUM
        if mode is Mode.CONTROL:
            assert any(item.wish and item.counter == command.pressure_counter for item in candidates)
        if mode in (Mode.HOLD, Mode.DECAY) and command.enable:
            assert used is not None
            assert now_ns - used.sampled_ns <= HELD_NS
            assert abs(flow) <= abs(before.flow_m2_per_s)
        if before.mode is Mode.FAULT and mode is not Mode.FAULT:
            assert candidates
            assert candidates[-1].wish


def campaign(bench_of, seed: int, calm: float, **settings) -> Campaign:
    rng = random.Random(seed)
    return Campaign(bench=bench_of(Hostile(rng), **settings), rng=rng, calm=calm)


EXPECTED = {
    *((mode, Reason.NONE) for mode in (Mode.OFF, Mode.WARMUP, Mode.CONTROL)),
    *((mode, reason) for mode in (Mode.HOLD, Mode.DECAY) for reason in (Reason.STREAM_LOST, Reason.SENSOR_INVALID)),
    *((mode, Reason.STALE) for mode in (Mode.HOLD, Mode.DECAY)),
    *((Mode.FAULT, reason) for reason in Reason if reason not in (Reason.NONE, Reason.NOT_AUTHENTIC)),
}
"""The wire is not authenticated here."""


def test_no_random_sequence_breaks_a_promise(bench_of):
    """Each way through the fail-safe is met, or the campaign would have shown nothing."""
    seen = campaign(bench_of, seed=1, calm=150.0).run(6_000)
    assert set(seen) >= EXPECTED, EXPECTED - set(seen)
    assert seen[Mode.CONTROL, Reason.NONE] > 1000


@pytest.mark.slow  # a hundred thousand periods
@pytest.mark.parametrize(
    ("seed", "calm", "settings"),
    [
        (2, 90.0, {}),
        (3, 40.0, {}),
        (4, 90.0, {"delay_steps": 2}),
        (5, 90.0, {"loss_limit": 50, "deadline_misses": 11, "rearm_frames": 1}),
        (6, 300.0, {}),
    ],
)
def test_no_long_random_sequence_breaks_a_promise(bench_of, seed, calm, settings):
    seen = campaign(bench_of, seed, calm, **settings).run(20_000)
    assert seen[Mode.CONTROL, Reason.NONE] > 200
