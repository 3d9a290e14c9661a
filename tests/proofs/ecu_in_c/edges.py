"""States an ECU can be in shortly before something changes: counts at their ends, times at their limits.

Traffic reaches few of them by itself. What a limit is, is worked out from the settings.
"""

from dataclasses import replace
from random import Random
from typing import Any, Final

import numpy as np

from can_bridge.command_gate import GateLimits
from can_bridge.e2e.profiles import SenderState, profile_of
from can_bridge.e2e.receiver import FrameCheck, ReceiverState, StreamState
from can_bridge.secoc.securing import Freshness, VerifierState
from can_bridge.wire.message_sets import message_set
from can_bridge.wire.message_specs import FLOW_RESOLUTION_M2_PER_S
from can_bridge.wire.messages import Reason
from contract.config.tree import Config
from contract.controller.air_speed import FIRST_PERIOD, MEAN_PERIODS
from ecu.benefit_check import MOVED, PATIENCE, BenefitCheckState
from ecu.controller_memory import DelayLine, Past
from ecu.ecu_state import EcuState
from ecu.fail_safe import OperatingMode
from ecu.pressure_reception import SILENCE_NS, OtherEcu
from ecu.speed_reception import AirSpeedState
from ecu.timing import LATEST_NS
from tests.proofs.ecu_in_c.senders import edges

LARGEST: Final = 2**32 - 1  # a count in C


class Edges:
    def __init__(self, config: Config, rng: Random) -> None:
        self._config, self._rng = config, rng
        self._limits = GateLimits.from_config(config)
        self._flow_scale = config.operating_point.flow_rate_scale
        self._counters = profile_of(message_set(config.bus).pressure.spec).counter_period
        self._longest = config.ecu.hold_periods + config.ecu.decay_periods

    def near(self, state: EcuState, now_ns: int) -> EcuState:
        """A state like this one before a step at `now_ns`, some of its parts moved."""
        if state.speed.air.means.size and self._rng.random() < 0.3:
            return self._driven_long(state, now_ns)
        if self._rng.random() < 0.3:
            return self._held(state, now_ns)
        moves = (
            self._fail_safe, lambda state, _: replace(state, pressures=self._received(state.pressures)), self._timing,
            self._memory, self._pressures, self._counts, self._company, self._benefit,
            *([] if state.memory.past is None else [self._speed]),
            *([self._authentication] if self._config.bus.key else []),
        )  # fmt: skip
        for move in self._rng.sample(moves, self._rng.randrange(1, 4)):
            state = move(state, now_ns)
        return state

    def _around(self, value: int, least: int = 0) -> int:
        return max(least, value + self._rng.randrange(-2, 3))

    def _bits(self, length: int, count: int) -> int:
        count = max(0, min(length, self._around(count)))
        return sum(1 << place for place in self._rng.sample(range(length), count))

    def _fail_safe(self, state: EcuState, _: int) -> EcuState:
        rng, ecu = self._rng, self._config.ecu
        # At power-on the request may rise long before pressures are usable; no loss is counted before it does.
        mode = OperatingMode.INIT if rng.random() < 0.15 else rng.choice(list(OperatingMode))
        starts = mode is OperatingMode.INIT
        changed = replace(
            state.fail_safe,
            mode=mode,
            misses=rng.choice((0, self._around(ecu.hold_periods), self._around(self._longest + 2 * starts))),
            good=rng.choice((0, self._around(ecu.rearm_frames), LARGEST)),
            lost=0 if starts else self._bits(ecu.loss_window, ecu.loss_limit),
            reason=rng.choice(list(Reason)),
            enable_request=rng.random() < (0.2 if starts else 0.6),
        )
        return replace(state, fail_safe=changed)

    def _authentication(self, state: EcuState, _: int) -> EcuState:
        rng, ends = self._rng, (0, LARGEST - 1, LARGEST)
        freshness = Freshness(trip=rng.choice((1, state.freshness.trip, LARGEST)), count=rng.choice((1, *ends)))
        speed = replace(state.speed, verifier=self._verifier(state.speed.verifier))
        return replace(state, verifier=self._verifier(state.verifier), speed=speed, freshness=freshness)

    def _verifier(self, state: VerifierState) -> VerifierState:
        rng, ends = self._rng, (0, LARGEST - 1, LARGEST)
        freshness = rng.choice((0, self._around(state.freshness), self._around(state.freshness)))
        return VerifierState(freshness=freshness, not_authentic=rng.choice(ends), not_fresh=rng.choice(ends))

    def _received(self, state: ReceiverState) -> ReceiverState:
        rng, e2e = self._rng, self._config.bus.e2e
        stream = rng.choice(list(StreamState))
        length = 0 if stream is StreamState.NODATA else rng.choice((e2e.window, rng.randrange(1, e2e.window + 1)))
        last = state.last_counter
        if last is None and stream is not StreamState.NODATA:
            last = rng.randrange(self._counters)
        return ReceiverState(
            stream=stream,
            last_counter=None if last is None else (last - rng.randrange(-1, e2e.max_delta + 2)) % self._counters,
            window=tuple(rng.choices(list(FrameCheck), weights=(3, 1, 1, 1, 2, 1), k=length)),
            counts=tuple(rng.choice((count, LARGEST, LARGEST - 1)) for count in state.counts),
        )

    def _timing(self, state: EcuState, now_ns: int) -> EcuState:
        rng, ecu, period = self._rng, self._config.ecu, self._config.period_ns
        elapsed = rng.choice((period, period // 2, 3 * period // 2, 0, 1, self._longest * period))
        step_ns = max(-1, min(LATEST_NS, now_ns - elapsed - rng.randrange(-2, 3)))
        changed = replace(
            state.timing,
            step_ns=None if rng.random() < 0.05 else step_ns,
            lag_ns=rng.choice((0, period // 2, -(period // 2), rng.randrange(-period, period), self._around(0, -9))),
            off_time=self._bits(ecu.deadline_window, min(ecu.deadline_window, ecu.deadline_misses)),
        )
        return replace(state, timing=changed)

    def _company(self, state: EcuState, now_ns: int) -> EcuState:
        """Another ECU that has been silent for just long enough to be gone, or not."""
        until_ns = max(0, min(LATEST_NS, now_ns)) + self._rng.choice((-1, 0, 1, SILENCE_NS))
        frames = self._rng.choice((1, LARGEST - 1, LARGEST))
        return replace(state, other_ecu=OtherEcu(frames=frames, until_ns=until_ns))

    def _benefit(self, state: EcuState, _: int) -> EcuState:
        """Means whose difference is about what control has to gain, shortly before a verdict."""
        rng, check = self._rng, self._config.ecu.benefit_check
        resting, swing = rng.choice((0.7, 1.1, -0.3, 0.0)), rng.choice((0.0, 0.5, 1.2))
        judged_by = rng.choice((1.0, resting))
        proven = check.wake_periods + check.mean_periods
        changed = BenefitCheckState(
            waking=rng.choice((0, 1, 2, check.wake_periods)),
            rested=min(proven, rng.choice((0, 1, self._around(check.mean_periods), self._around(proven)))),
            resting_suction=resting,
            resting_swing=swing,
            driven=min(check.first_period, rng.choice((0, self._around(check.first_period)))),
            suction=judged_by - check.least_gain * abs(judged_by) + rng.choice((-0.5, -0.01, 0.0, 0.01)),
            swing=rng.choice((0.0, swing, 1.0, 2.0)) * check.most_swing,
            doubt=min(check.doubt_periods, rng.choice((0, 1, self._around(check.doubt_periods)))),
            # At a speed that is left, or nearly so, by that of a state with or without one.
            tested_at=rng.choice((0.0, 1.0, 1.0 + MOVED, 0.85)),
            spent=min(PATIENCE * check.wake_periods, rng.choice((0, 1, self._around(PATIENCE * check.wake_periods)))),
        )
        return replace(state, benefit=changed)

    def _held(self, state: EcuState, now_ns: int) -> EcuState:
        """On time and in control up to now, by pressures at one of their largest ages."""
        rng, period_ns = self._rng, self._config.period_ns
        mode = rng.choice((OperatingMode.CONTROL, OperatingMode.HOLD, OperatingMode.DECAY))
        misses = rng.randrange(max(1, self._longest))
        fail_safe = replace(state.fail_safe, mode=mode, misses=misses, lost=0, enable_request=True)
        step_ns = max(-1, min(LATEST_NS, now_ns - period_ns + rng.choice((0, 0, period_ns // 4))))
        timing = replace(state.timing, step_ns=step_ns, lag_ns=0, off_time=0, fault=None)
        moved = replace(state, fail_safe=fail_safe, timing=timing, other_ecu=OtherEcu())
        if state.memory.past is not None:
            moved = self._speed(moved, now_ns)
        return self._memory(self._pressures(moved, now_ns), now_ns)

    def _driven_long(self, state: EcuState, now_ns: int) -> EcuState:
        """In control with a full past, so that the air speed is estimated by this period's pressures, if any come."""
        rng, moved = self._rng, self._held(state, now_ns)
        speed = replace(moved.speed, ratio=rng.choice((1.0, 0.7, 0.9, 1.3)), is_off=False)
        assert moved.memory.past is not None
        shape = moved.memory.past.rows.shape
        rows = np.array([rng.uniform(-1.0, 1.0) for _ in range(shape[0] * shape[1])]).reshape(shape)
        past = Past(rows=rows, speeds=np.full(len(rows), speed.ratio), count=len(rows))
        window, count = past.read(len(moved.memory.window))
        memory = replace(moved.memory, past=past, window=window, rows=count, gap=0)
        return replace(moved, speed=speed, memory=memory, sensors=replace(moved.sensors, set_aside=None))

    def _memory(self, state: EcuState, _: int) -> EcuState:
        rng, limit, step = self._rng, self._limits.flow_m2_per_s, self._limits.step_m2_per_s
        flows = (0.0, limit, -limit, step, -step, limit - step, rng.uniform(-limit, limit))
        values = [self._on_wire(rng.choice(flows)) for _ in state.memory.under_way.values]
        gap = rng.choice((0, min(self._longest + 1, self._around(self._longest))))
        return replace(state, memory=replace(state.memory, under_way=DelayLine(tuple(values)), gap=gap))

    def _speed(self, state: EcuState, now_ns: int) -> EcuState:
        """At an end of the range, by a measurement of the largest age or nearly so."""
        rng = self._rng
        measured_ns = now_ns - rng.choice((0, round(self._config.ecu.speed.oldest_ms * 1e6))) + rng.randrange(-2, 3)
        changed = replace(
            state.speed,
            ratio=rng.choice((None, 1.0, 1.0, 1.3, 0.7, *edges(self._config))),
            density=rng.choice((1.2, 0.9)),
            measured_ns=max(-(10**9), min(2**63 - 1, measured_ns)),
            is_off=rng.random() < 0.3,
            receiver=self._received(state.speed.receiver) if rng.random() < 0.3 else state.speed.receiver,
            air=self._air_speed(state.speed.air),
        )
        return replace(state, speed=changed)

    def _air_speed(self, air: AirSpeedState) -> AirSpeedState:
        most, first = self._config.ecu.speed.most_correction, self._around(FIRST_PERIOD)
        if not air.means.size:
            return air
        return AirSpeedState(
            correction=self._rng.choice((1.0, 1.0 - most, 1.0 + most, self._rng.uniform(1.0 - most, 1.0 + most))),
            driven=min(FIRST_PERIOD, self._rng.choice((0, 1, MEAN_PERIODS, first))),
            means=np.array([self._rng.choice((0.0, 0.2, -0.6)) for _ in air.means]),
        )

    def _on_wire(self, flow_m2_per_s: float) -> float:
        """An action as it could have been sent, or one or two steps of the wire away, in U_inf W."""
        steps = round(flow_m2_per_s / FLOW_RESOLUTION_M2_PER_S) + self._rng.randrange(-2, 3)
        return steps * FLOW_RESOLUTION_M2_PER_S / self._flow_scale

    def _pressures(self, state: EcuState, now_ns: int) -> EcuState:
        rng, limits = self._rng, self._limits
        age = rng.choice((0, limits.fresh_age_ns, limits.held_age_ns)) + rng.randrange(-2, 3)
        if rng.random() <= 0.05:
            return replace(state, pressure_ns=None, pressure_counter=None)
        # No frame is of a time before 0, and none is older than a message can hold.
        sampled_ns = max(-(10**9), min(2**63 - 1, now_ns - age))
        return replace(state, pressure_ns=sampled_ns, pressure_counter=rng.randrange(self._counters))

    def _counts(self, state: EcuState, _: int) -> EcuState:
        rng = self._rng
        ends: tuple[Any, ...] = (0, 62, 63, 64, 0xFFFE, 0xFFFF, LARGEST - 1, LARGEST)
        return replace(
            state,
            overruns=rng.choice(ends),
            missed=rng.choice(ends),
            commands=SenderState(counter=rng.choice((0, self._counters - 2, self._counters - 1))),
            statuses=SenderState(counter=rng.choice((0, self._counters - 2, self._counters - 1))),
            pressures=replace(state.pressures, counts=tuple(rng.choice(ends) for _ in state.pressures.counts)),
            health=replace(state.health, bus_off=rng.choice((0, 14, 15, 16, 255, 256, LARGEST))),
        )
