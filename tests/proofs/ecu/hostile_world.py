"""One ECU and one vehicle, and all that can go wrong between them in a control period.

`Events` hold what happens, drawn by `RandomEvents` from a seed or by a test; what it led to is a `Seen`. The bus has no
authentication here, so no one forges: a frame of another node is a copy with another counter, and copies of old frames
are up to a hundred periods old, of the same power cycle of their sender: a counter of 8 bits is the same after 256
periods and after a reset.
"""

from collections import deque
from dataclasses import dataclass, replace
from random import Random
from typing import Any, Final

import numpy as np

from can_bridge.bus.interface import HEALTHY, BusHealth, BusState
from can_bridge.e2e.profiles import PROFILE_5
from can_bridge.wire.message_specs import PRESSURE
from contract import sensors
from contract.arrays import Array
from contract.config.tree import Config
from contract.controller.interface import FORCES, ControllerError, ControlStep
from contract.release.checks import Bundle
from ecu.ecu import Ecu
from firmware_sim.bench.vehicle_node import VehicleNode
from tests.ecu.conftest import NAMES, make_bundle
from tests.proofs.ecu.promises import Delivered, EcuJudge, Seen, VehicleJudge

GOOD: Final = ("swing", "small", "huge")
"""Finite plans: from limit to limit and beyond, calm, and of 10^300 where a flow rate is still a number."""
BAD: Final = ("nan", "inf", "overflow", "raise", "memory", "none", "short", "flat", "object", "forces", "write")
"""No answer, or none that may drive a jet."""


class HostileController:
    """Does what it was prepared for; `called` tells whether a step was asked for since then."""

    def __init__(self) -> None:
        self._kept: list[Array] = []
        self.prepare("small", 0.0)

    def prepare(self, deed: str, value: float) -> None:
        """For the next step: one of `GOOD` or `BAD`, and the action that is planned, in U_inf W."""
        self._deed, self._value, self.called = deed, value, False

    def control_step(self, window: Array, plan: Array, *given: Any, **named: Any) -> ControlStep:
        """See `Controller`; it also spoils what it was given to read and write, and what it gave back before."""
        self.called, deed = True, self._deed
        for array in self._kept:
            array[...] = np.nan
        if deed in ("raise", "memory"):
            raise ControllerError("no answer") if deed == "raise" else MemoryError
        huge = 1e300 if self._value > 0 else -1e300
        level = {"small": 0.2 * self._value, "huge": huge, "nan": np.nan, "inf": np.inf, "overflow": 1.7e308}
        values, forces = np.full(len(plan), level.get(deed, self._value)), np.zeros((len(plan), FORCES))
        wrong = {"short": values[:-1], "flat": np.zeros((len(plan), 2)), "object": values.astype(object)}
        answer: Any = ControlStep(plan=wrong.get(deed, values), forces=forces, terms=np.zeros(8), cost=0.0)
        plan[:] = 7.0
        if deed == "forces":
            forces[-1, -1] = np.nan
        if deed == "write":
            window.fill(0.0)  # read-only
        self._kept = [values, forces]
        return answer if deed != "none" else None  # type: ignore[return-value]


START_NS: Final = 10**12
FATES: Final = ("pass", "lost", "late1", "late2", "late3", "twice", "flipped", "short", "replayed", "foreign")
"""Fates of a frame on its way; `replayed` and `foreign` add one to it."""
KEPT: Final = 100  # old frames that can be replayed


@dataclass(frozen=True, kw_only=True)
class Events:
    request: bool = True
    pressure: str = "pass"  # fate of the frame, of `FATES`
    command: str = "pass"
    valid: bool = True
    queued_ns: int = 1_000_000  # the pressure frame waited where its receiver knows of it
    elapsed_ns: int = 20_000_000  # what the ECU's clock makes of the time since its step before
    steps: bool = True
    bus_off: bool = False  # the ECU's CAN controller is
    unseen: bool = False  # it has recovered before the step
    deed: str = "swing"  # of the controller, see `HostileController`
    value: float = 0.05
    reset_ecu: bool = False
    reset_vehicle: bool = False
    chance: int = 0  # seed of where bits flip and which frame comes again


CALM: Final = [Events(request=k > 0) for k in range(10)]  # into control: the request rises with the second frame


class Path:
    """One message's way over the bus: frames put in come out in a later period, or not, or otherwise."""

    def __init__(self) -> None:
        self._under_way: list[tuple[int, Delivered]] = []
        self._kept: deque[Delivered] = deque(maxlen=KEPT)

    def forget(self) -> None:
        self._kept.clear()

    def carried(self, item: Delivered | None, fate: str, period: int, rng: Random) -> list[Delivered]:
        """What arrives in this period; `item` is what was sent in it."""
        if item is not None:
            if fate != "lost":
                late = int(fate[-1]) if fate.startswith("late") else 0
                self._under_way.append((period + late, _damaged(item, fate, rng)))
            if fate == "twice":
                self._under_way.append((period + rng.randrange(3), item))
            if fate == "replayed" and self._kept:
                # In front of the genuine one, or behind it.
                self._under_way.insert(rng.choice((0, len(self._under_way))), (period, rng.choice(self._kept)))
            if fate == "foreign":
                self._under_way.insert(0, (period, _foreign(item, rng)))
            self._kept.append(item)
        arrived = [one for due, one in self._under_way if due <= period]
        self._under_way = [(due, one) for due, one in self._under_way if due > period]
        return arrived


def _damaged(item: Delivered, fate: str, rng: Random) -> Delivered:
    frame = item.frame
    if fate == "flipped" and frame.data:
        # Up to three bits, which profile 5 finds in frames of this length: all of them were tried.
        data = int.from_bytes(frame.data, "big")
        for bit in rng.sample(range(8 * len(frame.data)), rng.randrange(1, 4)):
            data ^= 1 << bit
        return Delivered(replace(frame, data=data.to_bytes(len(frame.data), "big")), None)
    return Delivered(replace(frame, data=frame.data[:4]), None) if fate == "short" else item


def _foreign(item: Delivered, rng: Random) -> Delivered:
    """A frame of a second node with another count, as sound as the first one's; the vehicle sampled none of it."""
    data, spec = item.frame.data, PRESSURE
    if item.frame.frame_id != spec.frame_id:
        return item
    counter = (PROFILE_5.counter_of(data) + rng.randrange(20, 237)) % 256
    protected = PROFILE_5.protect(bytes(3) + data[3:], data_id=spec.data_id, counter=counter)
    return Delivered(replace(item.frame, data=protected), None)


class World:
    """Both nodes, and the two who judge them by `judged_by`, which is `config` unless a test plants a fault in the
    settings. `seen` is the latest period, `now_ns` is of the ECU's clock."""

    def __init__(self, config: Config, judged_by: Config | None = None) -> None:
        self.config, self._bundle, self._controller = config, small_bundle(config), HostileController()
        self.now_ns, self.seen = START_NS, Seen(period=-1, request=False)
        self._judges = EcuJudge(judged_by or config), VehicleJudge(judged_by or config)
        self._pressures, self._commands = Path(), Path()
        self._inbox: list[Delivered] = []
        self._health = HEALTHY
        self.ecu = Ecu(self._bundle, self._controller, config)
        self.node = VehicleNode(NAMES, config)

    def period(self, events: Events) -> list[str]:
        """Run one control period; names of the promises that it broke."""
        seen = Seen(self.seen.period + 1, events.request, events.reset_vehicle)
        try:
            self.seen, broken = self._lived_through(seen, events)
        except Exception as error:  # noqa: BLE001 - what this looks for
            self.seen = seen._replace(error=error)
            return ["exceptions"]
        return [*broken, *self._judges[1].judge(self.seen)]

    def _lived_through(self, seen: Seen, events: Events) -> tuple[Seen, list[str]]:
        rng, now_ns = Random(events.chance), self.now_ns + events.elapsed_ns
        if events.reset_ecu:
            self.ecu = Ecu(self._bundle, self._controller, self.config)
            self._health = HEALTHY
            self._inbox.clear()
            self._judges[0].reset()
            self._commands.forget()
        if events.reset_vehicle:
            self.node = VehicleNode(NAMES, self.config)
            self._pressures.forget()
        cp = np.full(sensors.COUNT, rng.uniform(-1.0, 1.0) if events.valid else rng.choice((np.nan, np.inf, 1e300)))
        sampled_ns = START_NS + seen.period * self.config.period_ns
        frame = self.node.sample(cp, enable_request=events.request, now_ns=sampled_ns)
        for item in self._pressures.carried(Delivered(frame, seen.period), events.pressure, seen.period, rng):
            stamped = replace(item.frame, timestamp_ns=max(0, now_ns - events.queued_ns))
            self._inbox.append(Delivered(stamped, item.sampled))
        sent, broken = None, list[str]()
        if events.steps:
            seen = self._stepped(seen, events, now_ns)
            broken = list(self._judges[0].judge(seen))
            used = self._judges[0].used
            if seen.answers:
                sent = Delivered(seen.answers[0], None if used is None else used.sampled)
        commands = self._commands.carried(sent, events.command, seen.period, rng)
        action = self.node.apply_commands([item.frame for item in commands]).action
        return seen._replace(commands=commands, action=action), broken

    def _stepped(self, seen: Seen, events: Events, now_ns: int) -> Seen:
        self.now_ns = now_ns
        pressures, self._inbox = self._inbox, []
        before, count = self._health, self._health.bus_off + events.bus_off
        state = BusState.BUS_OFF if events.bus_off and not events.unseen else BusState.ERROR_ACTIVE
        self._health = BusHealth(state=state, bus_off=count)
        self._controller.prepare(events.deed, events.value)
        answers = self.ecu.step(now_ns, [item.frame for item in pressures], self._health)
        off = state is BusState.BUS_OFF or count > before.bus_off
        bad = self._controller.called and events.deed in BAD
        return seen._replace(now_ns=now_ns, pressures=pressures, answers=answers, bus_off=off, bad_answer=bad)


def small_bundle(config: Config) -> Bundle:
    """A release for these settings, of so short a window and horizon that control is often reached, without a model."""
    flow, point = config.flow, config.operating_point
    return make_bundle(
        name="hostile", control_period=flow.control_period, action_limit=flow.action_limit, operating_point=point
    )


JUMPS_NS: Final = (0, -1, -200_000_000, -(10**10), -(10**13), 10**8, 10**9, 10**13)
UNEVEN_NS: Final = (1_000_000, 9_000_000, 15_000_000, 29_900_000, 40_000_000, 60_000_000)
QUEUED_NS: Final = (10_000_000, 25_000_000, 35_000_000, 90_000_000, -5_000_000)
PERIOD_NS: Final = 20_000_000


class RandomEvents:
    """Periods drawn from a seed: calm and hostile times, with losses in bursts. A stated hostility, 0 to 1, is kept."""

    def __init__(self, seed: int | str, hostility: float | None = None) -> None:
        self._rng, self._request, self._fixed, self.hostility = Random(seed), False, hostility, hostility or 0.0
        self._burst: list[str] = []

    def next(self, now_ns: int) -> Events:
        rng = self._rng
        if self._fixed is None and rng.random() < 1 / 300:
            self.hostility = rng.choice((0.0, 0.003, 0.01, 0.03, 0.1, 0.4))
        if rng.random() < (0.01 if self._request else 0.15):
            self._request = not self._request
        odd = self.hostility
        return Events(
            request=self._request,
            pressure=self._fate(),
            command=rng.choice(FATES) if rng.random() < odd else "pass",
            valid=rng.random() >= odd / 4,
            queued_ns=rng.choice(QUEUED_NS) if rng.random() < odd / 2 else rng.randrange(5_000_000),
            elapsed_ns=self._elapsed_ns(now_ns),
            steps=rng.random() >= odd / 10,
            bus_off=rng.random() < odd / 50,
            unseen=rng.random() < 0.5,
            deed=rng.choice(BAD) if rng.random() < odd / 30 else rng.choice(GOOD),
            value=rng.uniform(-0.15, 0.15),
            reset_ecu=rng.random() < odd / 100,
            reset_vehicle=rng.random() < odd / 100,
            chance=rng.getrandbits(32),
        )

    def _fate(self) -> str:
        rng = self._rng
        if self._burst:
            return self._burst.pop()
        if rng.random() < self.hostility / 10:
            self._burst = [rng.choice(FATES[1:])] * rng.randrange(1, 7)
        return rng.choice(FATES) if rng.random() < self.hostility else "pass"

    def _elapsed_ns(self, now_ns: int) -> int:
        rng = self._rng
        if now_ns < 0 and rng.random() < 0.1:
            return 10**13
        if rng.random() < self.hostility / 30:
            return rng.choice(JUMPS_NS)
        if rng.random() < self.hostility / 10:
            return rng.choice(UNEVEN_NS)
        return PERIOD_NS + round(rng.gauss(0.0, 0.02) * PERIOD_NS)
