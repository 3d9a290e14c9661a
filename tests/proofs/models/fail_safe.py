"""The fail-safe's states: every input from every state, in C and in Python at once, until no new state appears.

Counts beyond the last one that a condition asks for are one. Beside the code runs a witness of its own: it sees inputs
and modes, knows no table, and says what must not be.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import product
from pathlib import Path
from tempfile import mkdtemp
from typing import Any, Final

import cffi

from can_bridge.wire.messages import Reason
from contract.config.tree import Config
from contract.config.vehicle import EcuConfig
from ecu.fail_safe import FailSafe, OperatingMode, PeriodInputs
from ecu.in_c import compiler
from tests.proofs.ecu_in_c import library
from tests.proofs.ecu_in_c.planted import changed
from tests.proofs.ecu_in_c.variants import UNCHECKED

SOURCE: Final = "sw_fail_safe.c"
STEP: Final = "fail_safe_step.c"
_MODES: Final = tuple(OperatingMode)
_CONTROL, _HOLD = OperatingMode.CONTROL, OperatingMode.HOLD
_WANTED: Final = frozenset({OperatingMode.WARMUP, _CONTROL, _HOLD, OperatingMode.DECAY})

SETTINGS: Final = {
    "as small as can be": EcuConfig(hold_periods=0, decay_periods=0, rearm_frames=1, loss_window=2, loss_limit=2),
    "misses in a row": EcuConfig(hold_periods=1, decay_periods=2, rearm_frames=3, loss_window=5, loss_limit=5),
    "their number": EcuConfig(hold_periods=2, decay_periods=2, rearm_frames=2, loss_window=5, loss_limit=3),
}
"""Lengths of hold, decay and re-arming, and limits: as large as is needed for every row of the table."""
LENGTHS: Final = ("hold_periods", "decay_periods", "rearm_frames", "loss_window", "loss_limit")
"""The settings that the table depends on."""


class ViolationError(AssertionError):
    """The two differ, or what must not be is; with the inputs that lead there."""


@dataclass(frozen=True)
class Witness:
    """What has been seen from outside.

    Attributes:
        latched: no control was begun since power-on, or since the latest fault.
        asked: usable periods in a row that a fault asks for before it may end; 0 at power-on.
        good: usable periods in a row since the fault, up to those that are asked for.
        low: the request was low since.
        high: the request as last received.
        misses: periods without usable pressures in a row.
        window: a bit for each of the last periods in which control was wanted: 1 without usable pressures.
    """

    latched: bool = True
    asked: int = 0
    good: int = 0
    low: bool = False
    high: bool = True
    misses: int = 0
    window: int = 0

    def next(self, inputs: PeriodInputs, latch: bool, after: FailSafe, config: EcuConfig) -> "Witness":
        """What is seen after a period; raises ViolationError for what must not be."""
        own = inputs.fault is not None
        high = self.high if inputs.enable_request is None else inputs.enable_request
        good = min(self.good + 1, config.rearm_frames) if inputs.usable and not own else int(inputs.usable)
        misses = 0 if inputs.usable else min(self.misses + 1, config.hold_periods + config.decay_periods + 1)
        window = (self.window << 1 | (not inputs.usable)) & ((1 << config.loss_window) - 1)
        drives, wants, missing = after.mode.drives_jets, after.mode in _WANTED, not inputs.usable
        invalid = missing and inputs.unusable_because is Reason.STREAM_INVALID
        waits = inputs.off_speed or inputs.tests or not inputs.window_full
        ways = {
            "the jets run on a fault of the ECU's own": drives and (own or latch),
            "the jets run without a request": drives and not high,
            "a fault ends without good frames": self.latched and wants and good < self.asked,
            "control begins without a request that rises": self.latched and wants and not (high and self.low),
            "pressures are missing for too long": drives and misses > config.hold_periods + config.decay_periods,
            "pressures are missing too often": drives and missing and window.bit_count() >= config.loss_limit,
            "a stream that is not to be trusted moves jets": drives and invalid,
            "control without pressures, or while it must wait": after.mode is _CONTROL and (missing or waits),
            "a command is held for too long": after.mode is _HOLD and misses > config.hold_periods,
        }
        if wrong := [name for name, is_so in ways.items() if is_so]:
            raise ViolationError(wrong[0])
        is_fault = after.mode is OperatingMode.FAULT
        begins = is_fault and not (self.latched and self.asked)
        latched = is_fault or (self.latched and not wants)
        return Witness(
            latched=latched,
            asked=config.rearm_frames if is_fault else self.asked if latched else 0,
            good=0 if latch else good,
            low=latched and (inputs.enable_request is False or (self.low and not begins)),
            high=high,
            misses=misses,
            window=window if wants else 0,
        )


class Pair:
    """The table in C and in Python with the same settings; with a `change` in C, that one alone."""

    def __init__(self, config: EcuConfig, folder: Path, change: tuple[str, str] | None = None) -> None:
        contents = library.sources(Config(ecu=replace(config, sensor_check=UNCHECKED)))
        kept = {name: content for name, content in contents.items() if name.endswith(".h")}
        kept |= {SOURCE: contents[SOURCE], STEP: Path(__file__).with_name("c").joinpath(STEP).read_bytes()}
        if change is not None:
            kept = changed(kept, SOURCE, *change)
        # A path that was loaded before would give the library that was there.
        path = Path(mkdtemp(dir=folder), "fail_safe.so")
        compiler.compile_c(kept, path, compiler=compiler.host_compiler(), flags=(*library.SHARED, "-w"))
        self._ffi = cffi.FFI()
        self._ffi.cdef("void fail_safe_step(const uint64_t *, const uint8_t *, int, uint64_t *);")
        self._c = self._ffi.dlopen(str(path))
        self._after = self._ffi.new("uint64_t[6]")
        self.config, self._is_alone = config, change is not None

    def next(self, before: FailSafe, inputs: PeriodInputs, latch: bool = False) -> FailSafe:
        """The state after a period; raises ViolationError if both differ."""
        given = bytes([
            inputs.usable, inputs.enable_request is not None, bool(inputs.enable_request), inputs.unusable_because,
            inputs.window_full, inputs.off_speed, inputs.tests, inputs.fault or Reason.NONE, inputs.updating,
        ])  # fmt: skip
        self._c.fail_safe_step(_numbers(before), given, Reason.INTERNAL if latch else 0, self._after)
        mode, reason, request, misses, good, lost = found = list(self._after)
        if self._is_alone:
            return FailSafe(
                mode=_MODES[mode],
                reason=Reason(reason),
                enable_request=bool(request),
                misses=misses,
                good=good,
                lost=lost,
            )
        after = before.next(inputs, self.config)
        after = after.latch(Reason.INTERNAL) if latch else after
        if found != _numbers(after):
            raise ViolationError(f"{_numbers(after)} in Python, {found} in C")
        return after


def _numbers(state: FailSafe) -> list[int]:
    mode = _MODES.index(state.mode)
    return [mode, state.reason, state.enable_request, state.misses, state.good, state.lost]


def every_input() -> list[PeriodInputs]:
    """All that a period can bring; of the causes for which the jets wait, one at a time."""
    none: dict[str, Any] = {"window_full": True}
    waits = (none, {"window_full": False}, none | {"off_speed": True}, none | {"tests": True})
    missing = (Reason.STREAM_LOST, Reason.STREAM_INVALID, Reason.NOT_AUTHENTIC)
    arrived = [*product((True,), (True, False), (Reason.NONE,), waits)]
    arrived += product((False,), (None, True, False), missing, waits[:2])
    return [
        PeriodInputs(
            usable=usable, enable_request=request, unusable_because=reason, fault=fault, updating=updating, **wait
        )
        for usable, request, reason, wait in arrived
        for fault, updating in product((None, Reason.CLOCK), (False, True))
    ]  # fmt: skip


def explored(pair: Pair) -> dict[str, int]:
    """All states and steps from power-on on; raises ViolationError with the steps that lead to it."""
    config, inputs = pair.config, every_input()
    first = (FailSafe(), Witness())
    ways: dict[Any, tuple[Any, tuple[PeriodInputs, bool]] | None] = {_key(*first, config): None}
    new, steps, starts = [first], 0, 0
    for before, witness in new:
        for one, latch in product(inputs, (False, True)):
            try:
                after = pair.next(before, one)
                if latch and not after.mode.drives_jets:
                    continue  # the controller and the gate, which may latch, run with the jets alone
                after = pair.next(before, one, latch) if latch else after
                seen = witness.next(one, latch, after, config)
                if before.mode is OperatingMode.UPDATE and after.mode is not OperatingMode.UPDATE:
                    raise ViolationError("an update ends without a reset")
            except ViolationError as error:
                way = _told(ways, _key(before, witness, config))
                raise ViolationError(f"{error}, after {way}, by {one}") from error
            steps += 1
            key = _key(after, seen, config)
            if key not in ways:
                ways[key] = (_key(before, witness, config), (one, latch))
                new.append((after, seen))
        if before.mode is not OperatingMode.UPDATE:
            starts += 1
            # Good frames, a low request and a high one lead to control; silence shuts the jets in time.
            starts_by = [*[False] * config.rearm_frames, True]
            silence = [None] * (config.hold_periods + config.decay_periods + 1)
            is_started = _after(pair, before, starts_by).mode is OperatingMode.CONTROL
            if not is_started or _after(pair, before, silence).mode.drives_jets:
                raise ViolationError(f"control is not reached, or the jets not shut, from {before}")
    return {"states": len({key[0] for key in ways}), "with_witness": len(ways), "steps": steps, "started": starts}


def _key(state: FailSafe, witness: Witness, config: EcuConfig) -> tuple[Any, Witness]:
    """State and witness, with counts beyond the last one that counts as one, and reasons where they are kept."""
    reason = state.reason if state.mode is OperatingMode.FAULT else Reason.NONE
    misses = min(state.misses, config.hold_periods + config.decay_periods + 1)
    good = min(state.good, config.rearm_frames)
    return replace(state, reason=reason, misses=misses, good=good), witness


def _told(ways: dict[Any, Any], key: Any) -> list[str]:
    way = ways[key]
    if way is None:
        return []
    before, (inputs, latch) = way
    pressures = "usable" if inputs.usable else inputs.unusable_because.name
    request = {None: "no", True: "high", False: "low"}[inputs.enable_request]
    others = [name for name in ("fault", "updating") if getattr(inputs, name)] + ["latched"] * latch
    return [*_told(ways, before), " ".join((pressures, request, *others))]


def _after(pair: Pair, state: FailSafe, requests: Sequence[bool | None]) -> FailSafe:
    """The state after a period for each request; None is a period without a usable frame."""
    for request in requests:
        inputs = PeriodInputs(
            usable=request is not None, enable_request=request, unusable_because=Reason.STREAM_LOST, window_full=True
        )
        state = pair.next(state, inputs)
    return state
