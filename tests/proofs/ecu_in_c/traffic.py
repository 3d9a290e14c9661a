"""What can come to an ECU, by chance: calm and hostile times of bus, clock, sensors and networks.

The request, the clock, the fates of frames and the controller's deeds are those of the benchmark `hostile`; what
follows here is beyond it: frames of the ECU's own identifiers, of other nodes and of no use, payloads of any content
under a sound CRC, times at the ends of what C can hold, faults from outside, sensors that lie, and estimates that do.
"""

from collections.abc import Iterator
from dataclasses import replace
from itertools import cycle
from random import Random
from typing import Any, Final

import numpy as np

from can_bridge.bus.interface import BusHealth, BusState
from can_bridge.e2e.profiles import profile_of
from can_bridge.wire.frame import CLASSIC_LENGTHS, FD_LENGTHS, MAX_EXTENDED_ID, MAX_FRAME_ID, Frame
from can_bridge.wire.message_sets import SETS, message_set
from can_bridge.wire.messages import Pressure, Reason
from contract.arrays import Array
from contract.config.tree import Config
from contract.controller.calibration import Calibration
from ecu.calibrating import limits_of
from tests.proofs.ecu.hostile_world import START_NS, Events, Path, RandomEvents
from tests.proofs.ecu.promises import Delivered
from tests.proofs.ecu_in_c.library import FRAMES
from tests.proofs.ecu_in_c.python_twin import Answers, Period
from tests.proofs.ecu_in_c.senders import Drive, Sealing, flipped
from tests.proofs.ecu_in_c.variants import DEVIATION, bundle_of

VIEWS: Final = 34  # of four sensors (`contract.controller.estimator.views`)
LATEST: Final = 2**63 - 1  # that C's times can hold
EDGES: Final = (
    -LATEST - 1, -LATEST, -(2**62), -(2**61), -1, 0, 1, 2**61 - 1, 2**61, 2**61 + 1, 2**62, LATEST - 1, LATEST,
)  # fmt: skip
"""Times at which something could overflow, or cease to be valid."""
LIES: Final = ("dead", "stuck", "biased", "noisy", "two biased", "swapped", "all stuck", "all noisy", "alike", "copies")
FAULTS: Final = tuple(reason for reason in Reason if reason)
_WILD: Final = (np.nan, np.inf, -np.inf, 3.4e38, -3.4e38, 1e-45, 0.0, -0.0, 1.0)
_LARGE: Final = (0, 1, 127, 255, 256, 65_535, 2**32 - 1)


class Traffic(Iterator[Period]):
    """Periods drawn from a seed, without an end; H of the plans is `horizon`."""

    def __init__(self, config: Config, horizon: int, seed: str) -> None:
        self._events, self._rng = RandomEvents(seed), Random(seed)
        self._numbers = np.random.default_rng(self._rng.getrandbits(64))
        self._messages = message_set(config.bus)
        self._spec = self._messages.pressure.spec
        self._profile: Any = profile_of(self._spec)
        self._pascal, self._limit = config.operating_point.dynamic_pressure, self._messages.pressure_limit_pa
        bundle = bundle_of(config)
        self._horizon, self._limits = horizon, limits_of(bundle, config)
        self._drive = None if bundle.manifest.speeds is None else Drive(config, self._rng)
        self._path, self._speed_path, self._counter, self._number = Path(), Path(), 0, 0
        self._sealing, self._others_sealing = Sealing(config, self._rng), Sealing(config, self._rng)
        self._now_ns, self._stands = START_NS, 0
        self._health, self._inbox = BusHealth(), list[Frame]()
        self._lies = cycle(self._rng.sample(LIES, len(LIES)))
        self._lie, self._liars, self._stuck = "", (0, 1), np.zeros(4)
        self._updating, self._restarts = 0, True

    def __next__(self) -> Period:
        rng = self._rng
        events = self._events.next(self._now_ns)
        odd = self._events.hostility
        now_ns = self._time(events.elapsed_ns, odd)
        if events.reset_ecu or self._updating > 20 or rng.random() < 1 / 400:
            self._restarts, self._updating = True, 0
            self._health = BusHealth()
        cp = self._pressures(odd)
        estimates = self._estimates(cp, odd)
        if events.reset_vehicle:
            self._counter = rng.randrange(256)
            self._path.forget()
            self._sealing.restart()
        if self._drive is not None:
            self._drive.move(odd)
            self._pascal = self._drive.dynamic_pressure
            speed = self._drive.frame(now_ns, events.queued_ns, odd)
            item = None if speed is None else Delivered(speed, None)
            arrived = self._speed_path.carried(item, events.command, self._number, Random(events.chance))
            self._inbox += [one.frame for one in arrived]
        self._sample(events, cp, now_ns, odd)
        self._number += 1
        if not events.steps:
            return next(self)
        self._now_ns = now_ns
        frames, self._inbox = self._inbox[:FRAMES], []
        self._age_health(events, odd)
        self._updating += self._updating > 0 or rng.random() < odd / 200
        restarts, self._restarts = self._restarts, False
        # A delay that stays, and one that changes, end a past in different ways.
        calm = 0.0 if self._drive is None else 0.005
        return Period(
            now_ns=now_ns,
            frames=frames,
            health=self._health,
            fault=rng.choice(FAULTS) if rng.random() < odd / 40 else None,
            updating=self._updating > 0,
            answers=self._answers(events, estimates, odd),
            restarts=restarts,
            calibration=self._calibration() if rng.random() < calm + odd / 10 else None,
        )

    def _calibration(self) -> Calibration:
        """Within the limits of release and vehicle, at them, or just beyond."""
        rng, (least, greatest) = self._rng, (self._limits.least.values, self._limits.greatest.values)
        values = [rng.choice((low, high, rng.uniform(low, high))) for low, high in zip(least, greatest, strict=True)]
        if rng.random() < 0.3:
            place = rng.randrange(len(values))
            values[place] = rng.choice((least[place] * 0.9, greatest[place] * 1.1 + (place == len(values) - 1)))
        return Calibration.of(values)

    def _time(self, elapsed_ns: int, odd: float) -> int:
        rng = self._rng
        if self._stands:
            # Back from where no time is.
            now_ns, self._stands = (self._stands, 0) if rng.random() < 0.4 else (rng.choice(EDGES), self._stands)
            return now_ns
        if rng.random() < odd / 150:
            self._stands = abs(self._now_ns) % 2**60
            return rng.choice(EDGES)
        return max(-LATEST, min(LATEST, self._now_ns + elapsed_ns))

    def _pressures(self, odd: float) -> Array:
        """What the wall has, in Cp; what the sensors make of it is `_read`'s."""
        rng = self._rng
        if rng.random() < 0.01 + odd / 50:
            self._lie = next(self._lies) if not self._lie or rng.random() < 0.3 else ""
            one, other = rng.sample(range(4), 2)
            self._liars = (one, other)
            self._stuck = self._numbers.normal(0.0, 0.2, 4)
        phase = 0.19 * self._number + np.arange(4.0)
        found: Array = 0.2 * np.sin(phase) - 0.1 + self._numbers.normal(0.0, 0.3 * DEVIATION, 4)
        return found

    def _read(self, cp: Array) -> Array:
        seen, (i, j) = cp.copy(), self._liars
        if self._lie == "dead":
            seen[i] = 0.0
        elif self._lie == "stuck":
            seen[i] = self._stuck[i]
        elif self._lie in ("biased", "two biased"):
            seen[i] += 0.3
            seen[j] -= 0.25 * (self._lie == "two biased")
        elif self._lie in ("noisy", "all noisy"):
            scale = np.full(4, 0.3) if self._lie == "all noisy" else 0.3 * (np.arange(4) == i)
            seen += self._numbers.normal(0.0, 1.0, 4) * scale
        elif self._lie == "swapped":
            seen[[i, j]] = seen[[j, i]]
        elif self._lie == "all stuck":
            seen = self._stuck
        elif self._lie == "alike":
            seen[j] = seen[i]
        elif self._lie == "copies":
            seen[:] = seen[i]
        return seen

    def _estimates(self, cp: Array, odd: float) -> Array:
        rng = self._rng
        found: Array = cp + self._numbers.normal(0.0, DEVIATION, (VIEWS, 4))
        if rng.random() < odd / 60:
            found[rng.randrange(VIEWS)] = rng.choice((3e38, -3e38, 0.0, 1e-40))
        return _as_float32(found)

    def _sample(self, events: Events, cp: Array, now_ns: int, odd: float) -> None:
        """The vehicle's frame on its way, and what else is on the bus, into the inbox."""
        rng, spec = self._rng, self._spec
        read = tuple(np.clip(self._read(cp) * self._pascal, -self._limit, self._limit).tolist())
        valid = (True,) * 4 if events.valid else tuple(rng.random() < 0.7 for _ in range(4))
        is_odd = rng.random() < odd / 10
        age_ns = rng.randrange(655_000_000) if is_odd else rng.choice((0, 0, 1_000_000, 10_000_000))
        sampled = Pressure(pressure_pa=read, valid=valid, enable_request=events.request, age_ns=age_ns)
        data = self._messages.pressure.emit(sampled)
        if rng.random() < odd / 20:
            header = 3 if spec.profile == 5 else 2
            data = bytes(header) + rng.randbytes(spec.protected - header)
        frame = self._protected(data, self._counter, odd)
        self._counter = (self._counter + 1) % self._profile.counter_period
        fate = events.pressure
        if fate == "foreign":
            step = rng.randrange(2, self._profile.counter_period)
            foreign = self._protected(data, self._counter + step, odd)
            self._inbox.append(self._stamped(foreign, now_ns, events.queued_ns, odd))
            fate = "pass"
        for item in self._path.carried(Delivered(frame, None), fate, self._number, Random(events.chance)):
            self._inbox.append(self._stamped(item.frame, now_ns, events.queued_ns, odd))
        while rng.random() < odd / 3:
            self._inbox.insert(rng.randrange(len(self._inbox) + 1), self._other(now_ns, odd))

    def _protected(self, data: bytes, counter: int, odd: float) -> Frame:
        spec = self._spec
        sound = self._profile.protect(data, data_id=spec.data_id, counter=counter % self._profile.counter_period)
        return self._sealing.sealed(Frame(frame_id=spec.frame_id, data=sound, is_fd=spec.is_fd), spec, odd)

    def _stamped(self, frame: Frame, now_ns: int, queued_ns: int, odd: float) -> Frame:
        rng = self._rng
        time_ns = now_ns - queued_ns
        if rng.random() < odd / 20:
            near = [now_ns - oldest + off for oldest in (0, 20_000_000, 30_000_000) for off in (-1, 0, 1)]
            time_ns = rng.choice((*EDGES, *near, *near))
        return replace(frame, timestamp_ns=max(0, min(LATEST, time_ns)))

    def _other(self, now_ns: int, odd: float) -> Frame:
        """A frame of another node: of no use, or another ECU's, sound or not."""
        rng = self._rng
        kind = rng.choice(("any", "any", "extended", "long", "ours", "classic ours"))
        if rng.random() < 0.1:
            kind = "ecu"
        is_fd = rng.random() < 0.5
        frame_id = rng.randrange(MAX_FRAME_ID + 1)
        data = rng.randbytes(rng.choice(FD_LENGTHS if is_fd else CLASSIC_LENGTHS))
        if kind in ("extended", "long", "ours"):
            frame_id = rng.choice(self._messages.specs).frame_id
        if kind == "classic ours":
            frame_id = rng.choice(rng.choice(SETS).specs).frame_id
        if kind == "ecu":
            spec = rng.choice(self._messages.specs[2:])
            frame_id, is_fd = spec.frame_id, spec.is_fd
            content = rng.randbytes(spec.protected if rng.random() < 0.8 else rng.randrange(3, 9))
            data = self._profile.protect(content, data_id=spec.data_id, counter=rng.randrange(16))
            if len(data) == spec.protected:
                sound = Frame(frame_id=frame_id, data=data, is_fd=is_fd)
                data = self._others_sealing.sealed(sound, spec, odd).data
            data = self._misshapen(data)
        is_extended = kind == "extended" or (kind == "ecu" and rng.random() < 0.2)
        if kind == "extended" and rng.random() < 0.5:
            frame_id = rng.randrange(MAX_EXTENDED_ID + 1)
        frame = Frame(frame_id=frame_id, data=data, is_fd=is_fd, is_extended=is_extended)
        return self._stamped(frame, now_ns, rng.randrange(20_000_000), odd)

    def _misshapen(self, data: bytes) -> bytes:
        """Sometimes with a bit flipped, or of another length with the sound part in front."""
        rng, deed = self._rng, self._rng.random()
        if deed < 0.3:
            return flipped(data, 8 * rng.randrange(len(data)) + rng.randrange(8))
        if deed < 0.4:
            return data[: rng.choice((0, 1, 2, 3, 4, 7))]
        if deed < 0.5 and self._spec.is_fd:
            return data + bytes(64 - len(data))
        return data

    def _age_health(self, events: Events, odd: float) -> None:
        rng, old = self._rng, self._health
        state = BusState.BUS_OFF if events.bus_off and not events.unseen else BusState.ERROR_ACTIVE
        tx, rx = (rng.choice(_LARGE) if rng.random() < odd / 20 else n for n in (old.tx_errors, old.rx_errors))
        count = rng.choice(_LARGE) if rng.random() < odd / 200 else min(old.bus_off + events.bus_off, _LARGE[-1])
        self._health = BusHealth(state=state, bus_off=count, tx_errors=tx, rx_errors=rx)

    def _answers(self, events: Events, estimates: Array, odd: float) -> Answers:
        rng, horizon, deed, value = self._rng, self._horizon, events.deed, events.value
        plan = self._numbers.normal(0.0, 0.02, horizon) + (value if deed == "swing" else 0.2 * value)
        forces = self._numbers.normal(1.0, 0.2, (horizon, 2))
        if deed not in ("small", "swing") and rng.random() < 0.1 + odd:
            plan[rng.randrange(horizon)] = rng.choice(_WILD)
        if rng.random() < odd / 40:
            forces[rng.randrange(horizon), rng.randrange(2)] = rng.choice(_WILD)
        is_planned = rng.random() >= odd / 60
        return Answers(plan=_as_float32(plan), forces=_as_float32(forces), estimates=estimates, is_planned=is_planned)


def _as_float32(values: Array) -> Array:
    return values.astype(np.float32).astype(np.float64)
