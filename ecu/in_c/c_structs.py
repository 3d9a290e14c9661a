"""The structs of the ECU in C, in memory and as Python values: frames, state, trace.

cffi reads the layout from the library's own headers, so that the layout is not repeated here. All members have a fixed
width and are aligned to their own size, and none is a pointer, except at the end of `sw_ecu`. So the layout is the same
on this machine and on a microcontroller, and the same functions also read the memory of an emulated microcontroller.
"""

import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import fields, is_dataclass
from pathlib import Path
from typing import Any, Final, TypeVar

import cffi
import numpy as np

from can_bridge.bus.interface import BusHealth, BusState
from can_bridge.command_gate import Intervention
from can_bridge.e2e.receiver import FrameCheck, ReceiverState, StreamState
from can_bridge.e2e.sender import SenderState
from can_bridge.secoc.securing import Freshness, VerifierState
from can_bridge.wire.frame import Frame
from can_bridge.wire.messages import Reason
from contract.arrays import Array
from contract.errors import LibraryError
from ecu.air_speed import AirSpeedState
from ecu.benefit_check import BenefitCheckState
from ecu.controller_memory import ControllerMemory, DelayLine, Past
from ecu.ecu_state import EcuState, Trace
from ecu.fail_safe import FailSafe, OperatingMode
from ecu.in_c.compiler import preprocessed
from ecu.pressure_reception import OtherEcu
from ecu.sensor_check import SensorCheckState
from ecu.speed_reception import SpeedState
from ecu.timing import StepTiming

T = TypeVar("T")
_HEADER: Final = "sw_ecu.h"
_LARGEST: Final = {"int64": 2**63 - 1, "uint64": 2**64 - 1, "uint32": 2**32 - 1}
# The scratch memory is the last member of the ECU, so an opaque type can replace it: no other member moves.
_STANDING_IN: Final = {
    "sw_workspace.h": b"typedef struct { char not_shown; } sw_workspace;\n",
    "sw_estimator.h": b"typedef struct { char not_shown; } sw_estimator_work;\n",
    "stdint.h": b"\n",
    "stddef.h": b"\n",
}
_MODES: Final = tuple(OperatingMode)
_STREAMS: Final = tuple(StreamState)
_SENSOR_ARRAYS: Final = ("fast", "slow", "noise", "score", "estimates")
_HEALTH_COUNTS: Final = ("tx_errors", "rx_errors", "bus_off")


class Structs:
    """The structs of one library. `ffi` has the types and functions of a header that is or includes `sw_ecu.h`.
    Raises LibraryError if the sources contain no ECU, or if the compiler rejects the header."""

    def __init__(self, sources: Mapping[str, bytes], compiler: Sequence[str], header: str = _HEADER) -> None:
        if _HEADER not in sources:
            raise LibraryError(f"{_HEADER} is missing: this library has only the control step and no ECU")
        self.ffi: Any = cffi.FFI()
        headers = {name: content for name, content in sources.items() if name.endswith(".h") and "/" not in name}
        with tempfile.TemporaryDirectory() as folder:
            for name, content in (headers | _STANDING_IN).items():
                Path(folder, name).write_bytes(content)
            text = preprocessed(Path(folder, header), compiler=compiler, flags=("-nostdinc", "-I", folder))
        try:
            self.ffi.cdef(text)
            self._has_key = "freshness" in dict(self.ffi.typeof("sw_ecu_state").fields)
            self._serves_speeds = "past" in dict(self.ffi.typeof("sw_memory").fields)
        except (cffi.CDefError, cffi.FFIError, NotImplementedError) as error:
            raise LibraryError(f"{_HEADER}: {str(error).splitlines()[0]}") from error

    def size(self, name: str) -> int:
        """Return the size of a type in bytes; for `sw_ecu` the size without its workspace."""
        ecu = name == "sw_ecu"
        return int(self.ffi.offsetof("sw_ecu", "work") if ecu else self.ffi.sizeof(name))

    def frames(self, frames: Sequence[Frame]) -> Any:
        """Return an array of `sw_frame`."""
        found = self.ffi.new("sw_frame[]", len(frames))
        for place, frame in zip(found, frames, strict=True):
            fill_frame(place, frame)
        return found

    def frame(self, found: Any) -> Frame:
        """Return the frame in a `sw_frame`; raise ValueError if no CAN controller could send it."""
        return Frame(
            frame_id=found.id,
            data=bytes(self.ffi.buffer(found.data, found.length)),
            timestamp_ns=found.timestamp_ns,
            is_fd=bool(found.is_fd),
            is_extended=bool(found.is_extended),
        )

    def surround(
        self, surroundings: Any, health: BusHealth, *, fault: Reason | None = None, updating: bool = False
    ) -> None:
        self._set_health(surroundings.health, health)
        surroundings.fault = Reason.NONE if fault is None else fault
        surroundings.updating = updating

    def trace(self, ecu: Any) -> Trace:
        forces = self._array(ecu.output.forces, np.float32) if ecu.trace.planned else None
        if forces is not None and self._serves_speeds:
            # The plan's forces are in units of the newest row's speed; the trace is in units of the design speed.
            forces = forces * list(ecu.state.memory.past.speeds)[-1] ** 2
        return Trace(
            mode=_MODES[ecu.state.fail_safe.mode].on_wire,
            action=ecu.trace.action,
            forces=forces,
            interventions=Intervention(ecu.trace.interventions),
        )

    def state(self, state: Any) -> EcuState:
        """Return the state in a `sw_ecu_state`. C stores only whether the CAN controller is bus-off, no other error
        state. Raises ValueError or IndexError if a value is not in its enumeration."""
        memory, sensors = state.memory, state.sensors
        fail_safe, timing, other = state.fail_safe, state.timing, state.other_ecu
        return EcuState(
            memory=ControllerMemory(
                window=self._array(memory.window),
                rows=memory.rows,
                gap=memory.gap,
                plan=self._array(memory.plan, np.float32),
                under_way=DelayLine(tuple(memory.under_way)[: memory.frozen + 1]),
                past=_value(
                    Past, memory.past, rows=self._array(memory.past.rows), speeds=self._array(memory.past.speeds)
                )
                if self._serves_speeds
                else None,
            ),
            fail_safe=_value(
                FailSafe,
                fail_safe,
                mode=_MODES[fail_safe.mode],
                reason=Reason(fail_safe.reason),
                enable_request=bool(fail_safe.enable_request),
            ),
            pressures=_received(state.pressures),
            verifier=_verified(state.pressures),
            freshness=_value(Freshness, state.freshness) if self._has_key else Freshness(),
            speed=self._speed(state.speed) if self._serves_speeds else SpeedState(),
            commands=SenderState(counter=state.command_counter),
            statuses=SenderState(counter=state.status_counter),
            timing=_value(
                StepTiming,
                timing,
                step_ns=timing.step_ns if timing.has_step else None,
                fault=Reason(timing.fault) or None,
            ),
            other_ecu=_value(OtherEcu, other, until_ns=other.until_ns if other.is_there else None),
            pressure_ns=state.pressure_ns if state.has_pressures else None,
            pressure_counter=state.pressure_counter if state.has_pressures else None,
            overruns=state.overruns,
            missed=state.missed,
            sensors=_value(
                SensorCheckState,
                sensors,
                residual=self._known(sensors.residual, known=sensors.judged),
                **{name: self._array(getattr(sensors, name)) for name in _SENSOR_ARRAYS},
                readings=self._known(sensors.readings, known=sensors.has_read),
                flat=self._array(sensors.flat, np.uint32),
                set_aside=None if sensors.set_aside < 0 else sensors.set_aside,
                implausible=bool(sensors.implausible),
            ),
            benefit=_value(BenefitCheckState, state.benefit),
            health=_value(
                BusHealth, state.health, state=BusState.BUS_OFF if state.health.is_bus_off else BusState.ERROR_ACTIVE
            ),
        )

    def set_state(self, state: Any, value: EcuState) -> None:
        """Fill in a `sw_ecu_state`; counts saturate, and a library without a key has no state of authentication."""
        self.ffi.buffer(state)[:] = bytes(self.ffi.sizeof("sw_ecu_state"))
        self._set_memory(state.memory, value.memory)
        self._set_sensors(state.sensors, value.sensors)
        for item in fields(BenefitCheckState):
            setattr(state.benefit, item.name, getattr(value.benefit, item.name))
        _set_received(state.pressures, value.pressures)
        if self._serves_speeds:
            self._set_speed(state.speed, value.speed)
        if self._has_key:
            state.freshness.trip, state.freshness.count = value.freshness.trip, value.freshness.count
            _set_verified(state.pressures, value.verifier)
            if self._serves_speeds:
                _set_verified(state.speed.receiver, value.speed.verifier)
        fail_safe, safe = state.fail_safe, value.fail_safe
        fail_safe.mode, fail_safe.reason = _MODES.index(safe.mode), safe.reason
        fail_safe.enable_request, fail_safe.lost = safe.enable_request, safe.lost
        fail_safe.misses, fail_safe.good = _count(safe.misses), _count(safe.good)
        timing, timed = state.timing, value.timing
        timing.has_step, timing.step_ns = timed.step_ns is not None, c_time(timed.step_ns or 0)
        timing.fault = Reason.NONE if timed.fault is None else timed.fault
        timing.off_time, timing.lag_ns, timing.skipped = timed.off_time, c_time(timed.lag_ns), c_time(timed.skipped)
        other, heard = state.other_ecu, value.other_ecu
        other.is_there, other.frames = heard.until_ns is not None, _count(heard.frames)
        other.until_ns = c_time(heard.until_ns or 0)
        state.command_counter, state.status_counter = value.commands.counter, value.statuses.counter
        state.has_pressures = value.pressure_ns is not None
        state.pressure_counter, state.pressure_ns = value.pressure_counter or 0, c_time(value.pressure_ns or 0)
        state.overruns, state.missed = _count(value.overruns), _count(value.missed)
        self._set_health(state.health, value.health)

    def _set_memory(self, memory: Any, value: ControllerMemory) -> None:
        memory.rows, memory.gap = value.rows, _count(value.gap)
        self.copy(memory.window, value.window)
        self.copy(memory.plan, value.plan.astype(np.float32))
        memory.frozen, memory.under_way = len(value.under_way.pending), list(value.under_way.values)
        if value.past is not None:
            memory.past.count = value.past.count
            self.copy(memory.past.rows, value.past.rows)
            self.copy(memory.past.speeds, value.past.speeds)

    def _set_sensors(self, sensors: Any, value: SensorCheckState) -> None:
        sensors.set_aside = -1 if value.set_aside is None else value.set_aside
        sensors.implausible, sensors.doubt = value.implausible, _count(value.doubt)
        sensors.judged = not np.isnan(value.residual).any()
        sensors.has_read = not np.isnan(value.readings).any()
        sensors.flat = [_count(int(item)) for item in value.flat]
        if sensors.judged:
            self.copy(sensors.residual, value.residual)
        if sensors.has_read:
            self.copy(sensors.readings, value.readings)
        for name in _SENSOR_ARRAYS:
            self.copy(getattr(sensors, name), getattr(value, name))

    def copy(self, member: Any, values: Array) -> None:
        """Copy an array's bytes into a member of the same shape and type."""
        content = np.ascontiguousarray(values)
        assert content.nbytes == self.ffi.sizeof(member)
        self.ffi.memmove(member, content, content.nbytes)

    def _speed(self, speed: Any) -> SpeedState:
        return _value(
            SpeedState,
            speed,
            ratio=speed.ratio if speed.known else None,
            is_off=bool(speed.is_off),
            receiver=_received(speed.receiver),
            verifier=_verified(speed.receiver),
            air=_value(AirSpeedState, speed.air, means=self._array(speed.air.means))
            if hasattr(speed, "air")
            else AirSpeedState(),
        )

    def _set_speed(self, speed: Any, value: SpeedState) -> None:
        speed.known, speed.ratio = value.ratio is not None, value.ratio or 0.0
        speed.density, speed.measured_ns, speed.is_off = value.density, c_time(value.measured_ns), value.is_off
        if hasattr(speed, "air"):
            speed.air.correction, speed.air.driven = value.air.correction, value.air.driven
            self.copy(speed.air.means, value.air.means)
        _set_received(speed.receiver, value.receiver)

    @staticmethod
    def _set_health(health: Any, value: BusHealth) -> None:
        health.is_bus_off = value.state is BusState.BUS_OFF
        for name in _HEALTH_COUNTS:
            setattr(health, name, _count(getattr(value, name)))

    def _array(self, member: Any, dtype: Any = np.float64) -> Array:
        """Return a copy of an array with one or two dimensions, as float64."""
        flat = np.frombuffer(self.ffi.buffer(member), dtype=dtype).astype(np.float64)
        rows = self.ffi.typeof(member)
        return flat if rows.item.kind == "primitive" else flat.reshape(rows.length, -1)

    def _known(self, member: Any, *, known: int) -> Array:
        found = self._array(member)
        return found if known else np.full_like(found, np.nan)


def fill_frame(place: Any, frame: Frame) -> None:
    """Fill in a `sw_frame`. A time out of C's range is replaced by the nearest time in this range."""
    place.timestamp_ns = c_time(frame.timestamp_ns)
    place.id, place.is_extended, place.is_fd = frame.frame_id, frame.is_extended, frame.is_fd
    place.length = len(frame.data)
    place.data[0 : len(frame.data)] = frame.data


def _value(kind: type[T], place: Any, **given: Any) -> T:
    """Return a dataclass. A field that is not in `given` has the value of the struct's member of the same name."""
    names = (item.name for item in fields(kind) if item.name not in given)  # type: ignore[arg-type]  # any dataclass
    return kind(**{name: getattr(place, name) for name in names}, **given)


def _received(receiver: Any) -> ReceiverState:
    return ReceiverState(
        stream=_STREAMS[receiver.stream],
        last_counter=receiver.last_counter if receiver.has_counter else None,
        window=tuple(map(FrameCheck, list(receiver.window)[: receiver.checks])),
        counts=tuple(receiver.counts),
    )


def _set_received(receiver: Any, value: ReceiverState) -> None:
    receiver.stream = _STREAMS.index(value.stream)
    receiver.has_counter, receiver.last_counter = value.last_counter is not None, value.last_counter or 0
    receiver.checks, receiver.window = len(value.window), [item.value for item in value.window]
    receiver.counts = [_count(item) for item in value.counts]


def _verified(receiver: Any) -> VerifierState:
    """Return the authentication state of a `sw_receiver`; in a library without a key, the state at power-on."""
    return _value(VerifierState, receiver.verifier) if hasattr(receiver, "verifier") else VerifierState()


def _set_verified(receiver: Any, value: VerifierState) -> None:
    found = receiver.verifier
    found.freshness, found.not_authentic = value.freshness, _count(value.not_authentic)
    found.not_fresh = _count(value.not_fresh)


def flattened(value: object, name: str = "") -> dict[str, Any]:
    """Return a state, or any part of it, as a dictionary from dotted names to the values of single fields."""
    if is_dataclass(value) and not isinstance(value, type | DelayLine):
        parts = ((item.name, getattr(value, item.name)) for item in fields(value))
        return {
            key: leaf
            for part, content in parts
            for key, leaf in flattened(content, f"{name}.{part}" if name else part).items()
        }
    return {name: value}


def as_c_has_it(state: EcuState, *, is_keyed: bool) -> dict[str, Any]:
    """Return a state field by field, as far as C stores it: counts saturate, and authentication needs a key."""
    left_out = () if is_keyed else _OF_KEY
    found = {name: leaf for name, leaf in flattened(state).items() if not name.startswith(left_out)}
    found["health.state"] = found["health.state"] is BusState.BUS_OFF
    for name in ("pressures.counts", "speed.receiver.counts"):
        found[name] = tuple(map(_count, found[name]))
    found |= {name: _count(found[name]) for name in _COUNTED if name in found}
    found["sensors.flat"] = np.minimum(state.sensors.flat, _LARGEST["uint32"])
    return found


_OF_KEY: Final = ("verifier.", "freshness.", "speed.verifier.")
_COUNTED: Final = (
    "memory.gap", "other_ecu.frames", "fail_safe.misses", "fail_safe.good", "overruns", "missed", "sensors.doubt",
    "health.tx_errors", "health.rx_errors", "health.bus_off", "verifier.not_authentic", "verifier.not_fresh",
    "speed.verifier.not_authentic", "speed.verifier.not_fresh",
)  # fmt: skip


def differing(one: EcuState, other: EcuState, *, is_keyed: bool = False) -> list[str]:
    """Return the names of the fields that differ bit for bit, as far as C stores them; any two NaN are equal."""
    first, second = as_c_has_it(one, is_keyed=is_keyed), as_c_has_it(other, is_keyed=is_keyed)
    return [name for name, value in first.items() if not _same(value, second[name])]


def _same(one: Any, other: Any) -> bool:
    if isinstance(one, DelayLine) and isinstance(other, DelayLine):
        one, other = np.array(one.values), np.array(other.values)
    if isinstance(one, np.ndarray) and isinstance(other, np.ndarray):
        # Zeros must have equal signs; any two NaNs count as equal, even if their bits differ.
        return one.shape == other.shape and bool(
            ((one == other) & (np.signbit(one) == np.signbit(other)) | np.isnan(one) & np.isnan(other)).all()
        )
    return bool(one == other)


def _count(value: int) -> int:
    return min(value, _LARGEST["uint32"])


def c_time(value: int) -> int:
    """Return a time in the range of C: the nearest one, if the time is out of this range because the clock is wrong."""
    return max(-_LARGEST["int64"] - 1, min(value, _LARGEST["int64"]))
