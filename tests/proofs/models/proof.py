"""The fail-safe and flashing, explored state by state: the code itself, with every input, and every cut of the supply.

An exploration ends when no new state appears, and what it says holds for any number of steps. A sabotage is a line of
the exported C that is changed in a copy: the exploration must find it.
"""

import subprocess
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import product
from pathlib import Path
from tempfile import TemporaryDirectory, mkdtemp
from typing import Any, Final

import cffi

from benchmarks.common.command_line import track
from can_bridge.wire.messages import Reason
from contract.config.tree import Config
from contract.config.vehicle import EcuConfig
from contract.errors import StillwakeError
from ecu.c.sources import loader_sources
from ecu.fail_safe import FailSafe, OperatingMode, PeriodInputs
from ecu.in_c import compiler
from tests.proofs.command_line import JsonFile, report
from tests.proofs.ecu_in_c import library
from tests.proofs.ecu_in_c.planted import Planted, listed
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


class ViolationError(AssertionError):
    """The two differ, or what must not be is; with the inputs or calls that lead there."""


@dataclass(frozen=True)
class Witness:
    latched: bool = True  # no control was begun since power-on, or since the latest fault
    asked: int = 0  # usable periods in a row that a fault asks for before it may end; 0 at power-on
    good: int = 0  # usable periods in a row since the fault, up to those that are asked for
    low: bool = False  # the request was low since
    high: bool = True  # the request as last received
    misses: int = 0  # periods without usable pressures in a row
    window: int = 0  # a bit for each of the last periods in which control was wanted: 1 without usable pressures

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

    def __init__(self, config: EcuConfig, folder: Path, change: Planted | None = None) -> None:
        contents = library.sources(Config(ecu=replace(config, sensor_check=UNCHECKED)))
        kept = {name: content for name, content in contents.items() if name.endswith(".h")}
        kept |= {SOURCE: contents[SOURCE], STEP: Path(__file__).with_name("c").joinpath(STEP).read_bytes()}
        if change is not None:
            kept = change.into(kept)
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
        if not self._is_alone:
            after = before.next(inputs, self.config)
            after = after.latch(Reason.INTERNAL) if latch else after
            if found != _numbers(after):
                raise ViolationError(f"{_numbers(after)} in Python, {found} in C")
            return after
        return FailSafe(
            mode=_MODES[mode], reason=Reason(reason), enable_request=bool(request), misses=misses, good=good, lost=lost
        )


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
        PeriodInputs(usable=usable, enable_request=request, unusable_because=reason, fault=fault, updating=on, **wait)
        for usable, request, reason, wait in arrived
        for fault, on in product((None, Reason.CLOCK), (False, True))
    ]


def explored_fail_safe(pair: Pair) -> dict[str, int]:
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
        usable, lost = request is not None, Reason.STREAM_LOST
        inputs = PeriodInputs(usable=usable, enable_request=request, unusable_because=lost, window_full=True)
        state = pair.next(state, inputs)
    return state


SABOTAGE: Final = {part: listed(Path(__file__).with_name("sabotage.toml"), part) for part in ("fail_safe", "flashing")}
_FEW: Final = 1_500  # states in which a sabotage of flashing has to be found
_COMPILED: Final = (
    "sw_hashes.c", "sw_records.c", "sw_release.c", "sw_store.c", "sw_store_judge.c", "sw_store_kept.c",
)  # fmt: skip
SECTOR: Final = 960
"""Bytes of a sector: an image, or a key list and two states, so that every second state changes the sector."""
_FLAGS: Final = (
    "-O1", "-w", "-ffunction-sections", "-Wl,--gc-sections", f"-DSW_FLASH_SECTOR={SECTOR}u", "-DSW_SLOT_SECTORS=1u",
)  # fmt: skip


def store_sources() -> dict[str, bytes]:
    """The store's files, and the program; signatures are the program's."""
    found = {name: raw for name, raw in loader_sources().items() if name.endswith(".h") or name in _COMPILED}
    return found | {path.name: path.read_bytes() for path in Path(__file__).with_name("c").glob("store_*")}


def explored_flashing(folder: Path, most: int = 2**31, contents: Mapping[str, bytes] | None = None) -> dict[str, int]:
    """What `c/store_states.c` counts in at most so many states of the store's own C, over a small flash memory whose
    supply is cut; raises ViolationError for what is not allowed."""
    program = folder / "store_states"
    made_from = store_sources() if contents is None else contents
    compiler.compile_c(made_from, program, compiler=compiler.host_compiler(), flags=_FLAGS)
    done = subprocess.run([str(program), str(most)], stdout=subprocess.PIPE, text=True, check=False)
    if done.returncode == 1:
        raise ViolationError(done.stdout)
    done.check_returncode()
    return {name: int(count) for name, count in (line.split() for line in done.stdout.splitlines())}


def found(part: str, one: Planted, folder: Path) -> str:
    """What the exploration says to a changed line of this part; "" if it finds nothing."""
    try:
        if part == "flashing":
            explored_flashing(folder, _FEW, one.into(store_sources()))
        else:
            for config in SETTINGS.values():
                explored_fail_safe(Pair(config, folder, one))
    except ViolationError as error:
        text = str(error)
        return text.splitlines()[-1].partition(": ")[2] if part == "flashing" else text.partition(", after")[0]
    return ""


def main(json_file: JsonFile = None) -> None:
    """Explore all states of fail-safe and flashing, with each sabotage too. Fails at the first forbidden state."""
    parts = dict[str, dict[str, Any]]()
    with TemporaryDirectory() as name:
        folder = Path(name)
        pairs = (Pair(config, folder) for config in track(SETTINGS.values(), "fail-safe", "settings"))
        of_settings = list(map(explored_fail_safe, pairs))
        parts["fail_safe"] = {key: sum(one[key] for one in of_settings) for key in of_settings[0]}
        parts["flashing"] = explored_flashing(folder)
        sabotaged = [
            {"part": part, "what": one.what, "found": found(part, one, folder)}
            for part in parts
            for one in track(SABOTAGE[part], part, "sabotages")
        ]
    counts = {"sabotage": len(sabotaged), "sabotage_found": sum(bool(one["found"]) for one in sabotaged)}
    figures = {**parts, **counts, "sabotaged": sabotaged}
    lengths = ("hold_periods", "decay_periods", "rearm_frames", "loss_window", "loss_limit")
    settings = {name: {key: getattr(one, key) for key in lengths} for name, one in SETTINGS.items()}
    facts: dict[str, Any] = {"settings": settings, "sector_bytes": SECTOR}
    report(json_file, "models", figures, packages=("stillwake",), shown=(*parts, "sabotage_found"), **facts)
    if missed := [one["what"] for one in sabotaged if not one["found"]]:
        raise StillwakeError(f"{missed[0]}: the sabotage is not found")
