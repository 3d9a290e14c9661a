"""What must hold in every control period, whatever the bus, the clock and the controller do.

Judged from what went over the wire, when, and what the vehicle's jets did; range, rate and jets by the judge of every
bench (`firmware_sim.bench.invariants`). Each holds for an ECU that plans ahead, whose commands the vehicle follows in
the period after (`ecu.plan_ahead`), and for one that does not. Frames are read by cantools and autosar-e2e, from the
DBC, and limits are worked out here from the settings: nothing of the ECU's own code has a part in it.
"""

from collections import deque
from collections.abc import Iterator, Sequence
from typing import Any, Final, NamedTuple

from e2e.p05 import e2e_p05_check

from can_bridge.wire.frame import Frame
from contract.config.tree import Config
from firmware_sim.bench.invariants import Commands, HeardCommand, Jets
from tests.can_bridge.wire.described import DBC

PRESSURE, COMMAND, STATUS = "Pressure", "JetCommand", "EcuStatus"


def read(frame: Frame, name: str) -> dict[str, Any] | None:
    """The signals of a sound frame of this message, in the DBC's units; None if it is none."""
    message: Any = DBC.get_message_by_name(name)
    if (frame.frame_id, len(frame.data)) != (message.frame_id, message.length):
        return None
    # autosar-e2e takes a mutable buffer only.
    if not e2e_p05_check(bytearray(frame.data), int(message.dbc.attributes["E2EDataID"].value)):
        return None
    signals: dict[str, Any] = message.decode_simple(frame.data, decode_choices=False)
    return signals


MODES: Final = ("OFF", "WARMUP", "CONTROL", "HOLD", "DECAY", "FAULT")
DRIVING: Final = (2, 3, 4)
OFF, WARMUP, CONTROL, HOLD, DECAY, FAULT = range(6)  # as in the DBC's table of modes

PROMISES: Final = {
    "exceptions": "no exception leaves the ECU's step or the vehicle's node",
    "frames": "each step sends one JetCommand and one EcuStatus, sound, counted without a gap, of one mode",
    "bounds": "the command is within the action limit",
    "rate": "the command moves by no more than one step a period, and in less time by as much less; shutting is free",
    "shut unless active": "Enable is set in CONTROL, HOLD and DECAY alone, and without it the flow is zero",
    "clock": "shut in a step at which time stood still, went back or was negative",
    "bus-off": "shut while the CAN controller is bus-off and in the first step after",
    "controller": "shut, and FAULT, in a step in which the controller gave no finite plan",
    "fresh pressures": "a command in CONTROL echoes a sound frame of this step, with the request, of fresh pressures",
    "held pressures": "a command in HOLD is the one before, in DECAY half of it, by pressures in their longer budget",
    "loss limits": "while control is wanted, fewer than the limit of the latest periods have no usable frame, and no "
    "more than hold and decay in a row",
    "re-arming": "FAULT ends with the request, after enough usable frames in a row, the request low since it began",
    "power-on": "after a reset nothing is driven before the request was seen low and then raised",
    "reasons": "FAULT and jets that are shut in a driving mode have a Reason, CONTROL has none",
    "counts": "the status counts each period without a usable frame, and no count falls",
    "vehicle: bounds": "the jets' action is within the action limit",
    "vehicle: rate": "it moves by no more than one step a period; shutting is free",
    "vehicle: request": "it is zero while the vehicle does not want control",
    "vehicle: loss limits": "it is zero once as many of the latest periods under control as the limit says had no "
    "command, until the vehicle does not want control",
    "vehicle: doubt": "it is zero unless by a sound enabled command of a driving mode that echoes pressures which the "
    "vehicle sent at most five periods before; of commands in order by the newest one due, otherwise by one up to hold "
    "periods older",
}


class Delivered(NamedTuple):
    """A frame as it came out of the bus, with its receiver's time."""

    frame: Frame
    sampled: int | None  # the period in which the vehicle sampled the pressures behind it; None if it never did


class Seen(NamedTuple):
    """One control period, as somebody sees it who watches the wires."""

    period: int
    request: bool
    reset_vehicle: bool = False
    now_ns: int | None = None  # of the ECU's step; None if it did not step
    pressures: Sequence[Delivered] = ()  # that the ECU received since its step before
    answers: Sequence[Frame] = ()
    bus_off: bool = False  # the ECU's CAN controller is, or was since the step before
    bad_answer: bool = False  # its controller gave no finite plan in this step
    commands: Sequence[Delivered] = ()  # that the vehicle received, with what they rest on
    action: float = 0.0  # of the jets, U_inf W
    error: BaseException | None = None


class Used(NamedTuple):
    """A sound frame of pressures that a command may rest on."""

    counter: int
    sampled_ns: int
    request: bool
    sampled: int | None


class EcuJudge:
    """What the ECU promises; `judge` each of its steps. The latest command rests on the frame `used`."""

    def __init__(self, config: Config) -> None:
        ecu, self._config, self._period_ns = config.ecu, config, config.period_ns
        self._quantum = 0.0002
        self._held_ns = (1 + ecu.hold_periods + ecu.decay_periods) * config.period_ns
        self._fresh_ns = min(round(ecu.pressure_age * config.period_ns), self._held_ns)
        self._most_in_a_row = ecu.hold_periods + ecu.decay_periods
        self._loss_limit, self._rearm = ecu.loss_limit, ecu.rearm_frames
        self.reset()

    def reset(self) -> None:
        self.used: Used | None = None
        self._commands, self._mode = Commands(self._config), OFF
        self._step_ns: int | None = None
        self._counter = 0
        self._counts: dict[str, int] = dict.fromkeys(_COUNTS, 0)
        self._lost: deque[bool] = deque(maxlen=self._config.ecu.loss_window)
        self._in_a_row = self._good = 0
        self._low_since_fault = self._low_since_power_on = self._raised = False

    def judge(self, seen: Seen) -> Iterator[str]:
        assert seen.now_ns is not None
        now_ns, elapsed_ns = seen.now_ns, None if self._step_ns is None else seen.now_ns - self._step_ns
        messages = self._messages(seen.answers)
        sound, candidates = self._received(seen.pressures, now_ns)
        self._in_a_row = 0 if candidates else self._in_a_row + 1
        self._good = self._good + 1 if candidates else 0
        if messages is None:
            yield "frames"
            return
        command, status = messages
        mode, enable, flow = command["Mode"], bool(command["Enable"]), command["Flow"]
        echo = command["PressureCounter"] if command["PressureCounterValid"] else None
        named = [item for item in candidates if item.counter == echo]
        if named:
            self.used = named[-1]
        raised = any(item.request for item in candidates)
        # A frame of an invalid sensor or of old pressures has a request all the same.
        self._raised |= self._low_since_power_on and any(item["EnableRequest"] for item in sound)

        share = 1.0 if elapsed_ns is None else min(1.0, max(0, elapsed_ns) / self._period_ns)
        before = self._commands.flow
        broken = self._commands.broken(flow, enable=enable, drives=mode in DRIVING, share=share)
        yield from (_OF_INVARIANTS[name] for name, _ in broken)
        if enable and (now_ns < 0 or (elapsed_ns is not None and elapsed_ns <= 0)):
            yield "clock"
        if enable and seen.bus_off:
            yield "bus-off"
        if seen.bad_answer and (enable or mode != FAULT):
            yield "controller"
        if enable and mode == CONTROL and not any(item.request for item in named):
            yield "fresh pressures"
        if enable and mode in (HOLD, DECAY) and not self._holds(command, now_ns, before, share):
            yield "held pressures"
        if self._too_many_lost(mode, missing=not candidates):
            yield "loss limits"
        left_fault = self._mode == FAULT and mode != FAULT
        if left_fault and not (raised and self._low_since_fault and self._good >= self._rearm):
            yield "re-arming"
        if enable and not self._raised:
            yield "power-on"
        if not _has_its_reason(mode, enable=enable, reason=status["Reason"]):
            yield "reasons"
        if not self._counts_on(status, missing=not candidates):
            yield "counts"

        low = any(not item["EnableRequest"] for item in sound)
        self._low_since_power_on |= low
        self._low_since_fault = mode == FAULT and ((self._low_since_fault and self._mode == FAULT) or low)
        self._mode, self._step_ns = mode, now_ns

    def _messages(self, answers: Sequence[Frame]) -> tuple[dict[str, Any], dict[str, Any]] | None:
        if len(answers) != 2:
            return None
        command, status = read(answers[0], COMMAND), read(answers[1], STATUS)
        if command is None or status is None:
            return None
        counter, self._counter = self._counter, (self._counter + 1) % 256
        numbered = command["E2E_Counter"] == status["E2E_Counter"] == counter
        return (command, status) if numbered and status["State"] == command["Mode"] else None

    def _received(self, pressures: Sequence[Delivered], now_ns: int) -> tuple[list[dict[str, Any]], list[Used]]:
        """The signals of sound frames, and which of them a command may rest on."""
        sound, candidates = [], []
        for item in pressures:
            signals = read(item.frame, PRESSURE)
            if signals is None:
                continue
            sound.append(signals)
            sampled_ns = item.frame.timestamp_ns - round(signals["Age"] * 1e6)
            valid = all(signals[f"Valid{sensor}"] for sensor in range(4))
            if valid and 0 <= now_ns - sampled_ns <= self._fresh_ns:
                request = bool(signals["EnableRequest"])
                candidates.append(Used(signals["E2E_Counter"], sampled_ns, request, item.sampled))
        return sound, candidates

    def _holds(self, command: dict[str, Any], now_ns: int, before: float, share: float) -> bool:
        if self.used is None or not command["PressureCounterValid"]:
            return False
        if command["PressureCounter"] != self.used.counter or not 0 <= now_ns - self.used.sampled_ns <= self._held_ns:
            return False
        target = before if command["Mode"] == HOLD else 0.5 * before
        if abs(target - before) <= self._commands.reach(share) - self._quantum:
            return bool(abs(command["Flow"] - target) <= self._quantum)
        # In a step that came early even the way towards zero is limited.
        low, high = sorted((target, before))
        return bool(low - self._quantum <= command["Flow"] <= high + self._quantum)

    def _too_many_lost(self, mode: int, *, missing: bool) -> bool:
        wanted = mode in (WARMUP, *DRIVING)
        if not wanted:
            self._lost.clear()
            return False
        self._lost.append(missing)
        return missing and (self._in_a_row > self._most_in_a_row or sum(self._lost) >= self._loss_limit)

    def _counts_on(self, status: dict[str, Any], *, missing: bool) -> bool:
        before, self._counts = self._counts, {name: status[name] for name in _COUNTS}
        new = status["Missed"] - before["Missed"]
        full = before["Missed"] == 0xFFFF
        return all(status[name] >= before[name] for name in _COUNTS) and (full or missing <= new <= 1)


_COUNTS: Final = ("Missed", "Overruns", "CrcErrors", "Refused", "BusOff")


def _has_its_reason(mode: int, *, enable: bool, reason: int) -> bool:
    """NONE is 0, NOT_AUTHENTIC 8, NOT_ARMED 11."""
    if mode == FAULT:
        return reason not in (0, 11)
    if mode == OFF:
        return reason in (0, 8, 11)
    if mode == CONTROL:
        return (reason == 0) == enable
    return mode == WARMUP or reason != 0


class VehicleJudge:
    """What the vehicle's node promises by itself; `judge` each period."""

    def __init__(self, config: Config) -> None:
        self._jets = Jets(config)
        self._reset_at: int | None = None

    def judge(self, seen: Seen) -> Iterator[str]:
        if seen.reset_vehicle:
            self._reset_at = seen.period
            self._jets.reset()
        self._jets.heard([self._read(item, seen.period) for item in seen.commands], requested=seen.request)
        yield from (_OF_INVARIANTS[name] for name, _ in self._jets.broken(seen.action))

    def _read(self, item: Delivered, period: int) -> HeardCommand | None:
        command = read(item.frame, COMMAND)
        if command is None:
            return None
        # Counters start from 0 with the vehicle: an echo of the time before may name one of its first frames by chance.
        just_reset = self._reset_at is not None and period - self._reset_at <= 2 * self._jets.oldest
        oldest = self._jets.oldest * (2 if just_reset else 1)
        echoes = command["PressureCounterValid"] and item.sampled is not None
        return HeardCommand(
            counter=command["E2E_Counter"],
            wanted=command["Mode"] not in (OFF, FAULT),
            drives=command["Enable"] and command["Mode"] in DRIVING,
            in_time=bool(echoes) and item.sampled is not None and period - item.sampled <= oldest,
        )


_OF_INVARIANTS: Final = {
    "bus_bounds": "bounds",
    "bus_rate": "rate",
    "bus_shut": "shut unless active",
    "jets_bounds": "vehicle: bounds",
    "jets_rate": "vehicle: rate",
    "jets_request": "vehicle: request",
    "jets_losses": "vehicle: loss limits",
    "jets_shut": "vehicle: doubt",
}
"""Promises by the names that `firmware_sim.bench.invariants` gives them."""
