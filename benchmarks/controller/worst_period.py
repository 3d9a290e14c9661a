"""The longest control period of the firmware: constructed drives on the emulated board, and a bound from all drives.

A period is all work of the core from the end of one step to the end of the next step: the step, and one pass of the
main loop for each frame that wakes the core. Each constructed drive makes steps longer by another cause. The bound adds
the largest number of cycles that each basic block of the firmware took in any period of any drive. So it assumes that
all worst cases come together in one period.
"""

from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from copy import deepcopy
from dataclasses import replace
from typing import Any, Final, NamedTuple

import numpy as np

from can_bridge.bus.interface import HEALTHY, BusHealth
from can_bridge.e2e.profiles import E2eSender
from can_bridge.secoc.key import Key
from can_bridge.secoc.securing import Freshness, secure
from can_bridge.wire.frame import Frame
from can_bridge.wire.frame_bits import frame_ns
from can_bridge.wire.message_sets import message_set
from can_bridge.wire.messages import Mode, Pressure, VehicleSpeed
from contract.config.tree import Config
from contract.controller.c_folder import ProgramRows
from contract.errors import McuError
from firmware_sim.mcu.board.board_ecu import BoardEcu
from firmware_sim.mcu.build import CORTEX_M7, Firmware
from firmware_sim.mcu.measure import flash_bytes, linked_ram

KEY_BYTES: Final = bytes(range(1, 17))
"""Key of the bus in the firmware with authentication."""
_KEY: Final = Key(KEY_BYTES)
_WARM: Final = 80
"""Number of periods after which the window is full and the ECU is in control."""
_OWN_GOAL: Final = "the release's own goal"
_TINY_NUMBERS: Final = "the smallest numbers"
_TINY: Final = 5e-324
"""The smallest positive number; software floating point takes longer with this number."""
_ROOM: Final = 120
"""Largest number of other frames in a period that the firmware can store in addition to the vehicle's own frames."""


class Vehicle:
    """The frames that a vehicle sends: recorded pressures, which repeat, and a speed; `rows` are as in `worst_periods`.
    If `asks`, the vehicle requests control from its second period on."""

    def __init__(self, config: Config, rows: ProgramRows, *, asks: bool = True) -> None:
        self.config, self._rows, self._asks, self.number = config, rows, asks, 0
        self._messages = message_set(config.bus)
        self._senders = [E2eSender(one.spec) for one in (self._messages.speed, self._messages.pressure)]
        self._freshness = Freshness()
        self.held: int | None = None

    @property
    def now_ns(self) -> int:
        """Start time of the next period in ns."""
        return (self.number + 1) * self.config.period_ns

    def frames(self, *, ratio: float = 0.9) -> list[Frame]:
        """Return the frames of the next period, the Pressure frame last; `ratio` is the speed in design speeds."""
        point, cp = self.config.operating_point, self._rows[self.number % len(self._rows), :-1].copy()
        if self.held is not None:
            cp[self.held] = self._rows[0, self.held]
        pressure = Pressure(
            pressure_pa=tuple((point.dynamic_pressure * ratio**2 * cp).tolist()),
            valid=(True,) * len(cp),
            enable_request=self._asks and self.number > 0,
            age_ns=0,
        )
        speed = VehicleSpeed(speed_m_per_s=ratio * point.speed, age_ns=0)
        payloads = self._messages.speed.emit(speed), self._messages.pressure.emit(pressure)
        now_ns, self.number = self.now_ns, self.number + 1
        sent = [sender.frame(payload, now_ns=now_ns) for sender, payload in zip(self._senders, payloads, strict=True)]
        if not self.config.bus.key:
            return sent
        self._freshness = self._freshness.next()
        specs = self._messages.speed.spec, self._messages.pressure.spec
        return [secure(frame, spec, _KEY, self._freshness) for frame, spec in zip(sent, specs, strict=True)]

    def flood(self, frame: Frame) -> list[Frame]:
        """Return as many copies of the frame as the bus can carry in a period, at most `_ROOM`. With a key of the bus,
        the copies are forged: their last byte is changed."""
        bus = self.config.bus
        takes_ns = frame_ns(frame, nominal_bitrate=bus.nominal_bitrate, data_bitrate=bus.data_bitrate)
        other = replace(frame, data=frame.data[:-1] + bytes([frame.data[-1] ^ 1])) if bus.key else frame
        return [other] * min(self.config.period_ns // takes_ns, _ROOM)


class Period(NamedTuple):
    """A control period that starts late by `late_ns`. The frames of the flood wake the core before the vehicle's
    frames."""

    frames: Sequence[Frame]
    flood: Sequence[Frame] = ()
    health: BusHealth = HEALTHY
    late_ns: int = 0


class Measured(NamedTuple):
    """The work of a control period. If `is_mean`, the ECU is in control with the release's own goal."""

    drive: str
    cycles: int
    instructions: int
    is_mean: bool


Most = dict[int, int]
"""Largest number of cycles that a basic block took in a period, by the block's address."""


def worst_periods(
    sources: Mapping[str, bytes],
    config: Config,
    rows: ProgramRows,
    *,
    firmware: Firmware | None = None,
    drives: Iterable[str] | None = None,
) -> dict[str, Any]:
    """Run the drives and return the time and memory that the firmware needs: times in ms for each clock in MHz, memory
    in bytes. Raises McuError if the library does not compile or run, or the ECU does not take control.

    `sources` are the files of the library by name, among them `sw_ecu_settings.h`; `firmware` is compiled from them if
    it is None. With `bus.key` in `config`, frames are authenticated. `rows` are n recorded rows with the pressures Cp
    at the S sensors and the action, shape (n, S+1). `drives` are run after the warm-up; None means all drives.
    """
    secret = KEY_BYTES if config.bus.key else None
    ecu, vehicle = BoardEcu(sources, firmware=firmware, secret=secret), Vehicle(config, rows)
    most, frames = Most(), 0
    own = ecu.calibration
    asked = replace(own, weights=replace(own.weights, lift_mean=1e-3, rate=1e-3, smoothness=1e-3))
    ran = [_period(ecu, vehicle.now_ns, Period(frames=vehicle.frames()), _OWN_GOAL, most) for _ in range(_WARM)]
    if not any(one.is_mean for one in ran):
        raise McuError(f"the ECU did not take control within {_WARM} control periods")
    saved, stack = ecu.saved(), ecu.board.stack_depth()
    for name in _DRIVES if drives is None else drives:
        there = deepcopy(vehicle)
        started_ns = there.now_ns - config.period_ns // 2
        ecu = BoardEcu(sources, firmware=ecu.firmware, now_ns=started_ns, secret=secret)
        if name != _OWN_GOAL:
            ecu.calibrate(asked)
        ecu.restore(_tiny(ecu, saved) if name == _TINY_NUMBERS else saved)
        for period in _DRIVES[name](there):
            ran.append(_period(ecu, there.now_ns - config.period_ns + period.late_ns, period, name, most))
            frames = max(frames, len(period.flood))
        stack = max(stack, ecu.board.stack_depth())
    worst = max(ran, key=lambda one: (one.cycles, one.instructions))
    in_control = [one for one in ran if one.is_mean]
    instructions = [one.instructions for one in in_control]
    names = dict.fromkeys(one.drive for one in ran)
    return {
        "mean_ms": _ms(float(np.mean([one.cycles for one in in_control]))),
        "worst_ms": _ms(worst.cycles),
        # The bound assumes one period in which every block takes its largest number of cycles of all periods.
        "bound_ms": _ms(sum(most.values())),
        "drives_ms": {name: _ms(max(one.cycles for one in ran if one.drive == name)) for name in names},
        "instructions": worst.instructions,
        "instruction_spread": max(instructions) - min(instructions),
        "frames": frames,
        "flash_bytes": flash_bytes(ecu.firmware),
        "ram_bytes": linked_ram(ecu.firmware) + stack,
        "stack_b": stack,
    }


def _ms(cycles: float) -> dict[str, float]:
    return {str(clock): cycles / (clock * 1e3) for clock in CORTEX_M7.clocks_mhz}


def _period(ecu: BoardEcu, now_ns: int, period: Period, name: str, most: Most) -> Measured:
    """Run a control period, and update the largest number of each block in `most`."""
    instructions, cycles = 0, Counter[int]()

    def count() -> None:
        nonlocal instructions
        for address, of_block, took in ecu.board.blocks.blocks():
            instructions += of_block
            cycles[address] += took

    if period.flood:
        ecu.board.blocks.start()
        for frame in period.flood:
            ecu.advance(ecu.board.counter.now_ns + 1000, [frame])
        count()
    ecu.step(now_ns, period.frames, period.health)
    count()
    most |= {address: max(most.get(address, 0), took) for address, took in cycles.items()}
    return Measured(name, cycles.total(), instructions, name == _OWN_GOAL and ecu.trace.mode is Mode.CONTROL)


def _tiny(ecu: BoardEcu, saved: bytes) -> bytes:
    """Return the saved state with `_TINY` for every mean of the sensor check and of the benefit check."""
    ffi = ecu.structs.ffi
    state = ffi.new("sw_ecu_state *")
    ffi.buffer(state)[:] = saved
    sensors = state.sensors
    for table in (sensors.residual, sensors.fast, sensors.slow, sensors.noise, sensors.score):
        for row in table:
            for s in range(len(row)):
                row[s] = _TINY
    state.benefit.resting_swing = state.benefit.swing = _TINY
    return bytes(ffi.buffer(state))


def _steady(vehicle: Vehicle) -> Iterator[Period]:
    for _ in range(24):
        yield Period(frames=vehicle.frames())


def _full_bus(vehicle: Vehicle) -> Iterator[Period]:
    before = vehicle.frames()
    yield Period(frames=before)
    for _ in range(12):
        frames = vehicle.frames()
        yield Period(frames=frames, flood=vehicle.flood(frames[-1] if vehicle.config.bus.key else before[-1]))
        before = frames


def _left_out(vehicle: Vehicle) -> Iterator[Period]:
    vehicle.held = 1
    for _ in range(48):
        yield Period(frames=vehicle.frames())


def _at_all_speeds(vehicle: Vehicle) -> Iterator[Period]:
    for ratio in (*np.linspace(0.9, 1.2, 16), *np.linspace(1.2, 0.7, 26)):
        yield Period(frames=vehicle.frames(ratio=float(ratio)))


def _lost(vehicle: Vehicle) -> Iterator[Period]:
    """Yield lost frames, a bus-off, a late period, and a gap of half a second, with undisturbed periods in between."""
    for lost in (1, 2, 4):
        for _ in range(lost):
            vehicle.frames()
            yield Period(frames=())
        yield from (Period(frames=vehicle.frames()) for _ in range(4))
    frames = vehicle.frames()
    yield Period(frames=frames, health=BusHealth(tx_errors=255, rx_errors=127, bus_off=1))
    yield Period(frames=vehicle.frames(), late_ns=vehicle.config.period_ns // 3)
    for _ in range(24):
        vehicle.frames()
    yield from (Period(frames=vehicle.frames()) for _ in range(4))


_DRIVES: Final = {
    _OWN_GOAL: _steady,
    "iterations": _steady,
    "full bus": _full_bus,
    "a sensor left out": _left_out,
    "all speeds": _at_all_speeds,
    "lost frames": _lost,
    _TINY_NUMBERS: _steady,
}
