"""The structs of the ECU in C, in memory and as Python values: frames, state, trace.

cffi reads the layout from the library's own headers, so that the layout is not repeated here. All members have a fixed
width and are aligned to their own size, and none is a pointer, except at the end of `sw_ecu`. So the layout is the same
on this machine and on a microcontroller, and the same functions also read the memory of an emulated microcontroller.
"""

import tempfile
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import fields
from pathlib import Path
from typing import Any, Final, NamedTuple, TypeVar

import cffi
import numpy as np

from can_bridge.bus.interface import BusHealth, BusState
from can_bridge.command_gate import Intervention
from can_bridge.e2e.profiles import SenderState
from can_bridge.e2e.receiver import FrameCheck, ReceiverState, StreamState
from can_bridge.secoc.securing import Freshness, VerifierState
from can_bridge.wire.frame import Frame
from can_bridge.wire.messages import Reason
from contract.arrays import Array
from contract.errors import LibraryError
from ecu.benefit_check import BenefitCheckState
from ecu.controller_memory import ControllerMemory, DelayLine, Past
from ecu.ecu_state import EcuState, Trace
from ecu.fail_safe import FailSafe, OperatingMode
from ecu.in_c.compiler import preprocessed
from ecu.pressure_reception import OtherEcu
from ecu.sensor_check import SensorCheckState
from ecu.speed_reception import AirSpeedState, SpeedState
from ecu.timing import StepTiming

T = TypeVar("T")
_HEADER: Final = "sw_ecu.h"
_MOST: Final = 2**32 - 1
_RANGES: Final = {"uint32_t": (0, _MOST), "int64_t": (-(2**63), 2**63 - 1)}
"""Ranges of counts and of times in C."""
# An opaque type can replace the scratch memory: only `numbers`, which Python does not read, follows it in `sw_ecu`.
_STANDING_IN: Final = {
    "sw_workspace.h": b"typedef struct { char not_shown; } sw_workspace;\n",
    "sw_estimator.h": b"typedef struct { char not_shown; } sw_estimator_work;\n",
    "stdint.h": b"\n",
    "stddef.h": b"\n",
}
_MODES: Final = tuple(OperatingMode)
_STREAMS: Final = tuple(StreamState)
_NUMBERS: Final = {"double": np.float64, "float": np.float32, "uint32_t": np.uint32}


class Leaf(NamedTuple):
    """A number or an array of numbers in a struct: its name, its bytes `begin` to `end`, and its type in cffi."""

    name: str
    begin: int
    end: int
    kind: Any


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
        """Return the frame in a `sw_frame`; raise ValueError if no CAN controller could send this frame."""
        data, stamp_ns = bytes(self.ffi.buffer(found.data, found.length)), found.timestamp_ns
        is_fd, is_extended = bool(found.is_fd), bool(found.is_extended)
        return Frame(frame_id=found.id, data=data, timestamp_ns=stamp_ns, is_fd=is_fd, is_extended=is_extended)

    def surround(
        self, surroundings: Any, health: BusHealth, *, fault: Reason | None = None, updating: bool = False
    ) -> None:
        self._fill(surroundings.health, health, is_bus_off=health.state is BusState.BUS_OFF)
        surroundings.fault = Reason.NONE if fault is None else fault
        surroundings.updating = updating

    def trace(self, ecu: Any) -> Trace:
        forces = self._array(ecu.output.forces) if ecu.trace.planned else None
        if forces is not None and self._serves_speeds:
            # The plan's forces are in units of the newest row's speed; the trace is in units of the design speed.
            forces = forces * list(ecu.state.memory.past.speeds)[-1] ** 2
        mode, interventions = _MODES[ecu.state.fail_safe.mode].on_wire, Intervention(ecu.trace.interventions)
        return Trace(mode=mode, action=ecu.trace.action, forces=forces, interventions=interventions)

    def state(self, state: Any) -> EcuState:
        """Return the state in a `sw_ecu_state`. C stores only whether the CAN controller is bus-off, no other error
        state. Raises ValueError or IndexError if a value is not in its enumeration."""
        memory, sensors, fail_safe, timing = state.memory, state.sensors, state.fail_safe, state.timing
        under_way = DelayLine(tuple(memory.under_way)[: memory.frozen + 1])
        past = self._read(Past, memory.past) if self._serves_speeds else None
        nothing = np.full(self._array(sensors.residual).shape, np.nan)
        residual = self._array(sensors.residual) if sensors.judged else nothing
        readings = self._array(sensors.readings) if sensors.has_read else nothing[0]
        set_aside = None if sensors.set_aside < 0 else sensors.set_aside
        step_ns = timing.step_ns if timing.has_step else None
        until_ns = state.other_ecu.until_ns if state.other_ecu.is_there else None
        bus = BusState.BUS_OFF if state.health.is_bus_off else BusState.ERROR_ACTIVE
        return EcuState(
            memory=self._read(ControllerMemory, memory, under_way=under_way, past=past),
            fail_safe=self._read(FailSafe, fail_safe, mode=_MODES[fail_safe.mode], reason=Reason(fail_safe.reason)),
            pressures=_received(state.pressures),
            verifier=self._verified(state.pressures),
            freshness=self._read(Freshness, state.freshness) if self._has_key else Freshness(),
            speed=self._speed(state.speed) if self._serves_speeds else SpeedState(),
            commands=SenderState(counter=state.command_counter),
            statuses=SenderState(counter=state.status_counter),
            timing=self._read(StepTiming, timing, step_ns=step_ns, fault=Reason(timing.fault) or None),
            other_ecu=self._read(OtherEcu, state.other_ecu, until_ns=until_ns),
            pressure_ns=state.pressure_ns if state.has_pressures else None,
            pressure_counter=state.pressure_counter if state.has_pressures else None,
            overruns=state.overruns,
            missed=state.missed,
            sensors=self._read(SensorCheckState, sensors, residual=residual, readings=readings, set_aside=set_aside),
            benefit=self._read(BenefitCheckState, state.benefit),
            health=self._read(BusHealth, state.health, state=bus),
        )

    def _speed(self, speed: Any) -> SpeedState:
        ratio = speed.ratio if speed.known else None
        receiver, verifier = _received(speed.receiver), self._verified(speed.receiver)
        air = self._read(AirSpeedState, speed.air) if hasattr(speed, "air") else AirSpeedState()
        return self._read(SpeedState, speed, ratio=ratio, receiver=receiver, verifier=verifier, air=air)

    def _verified(self, receiver: Any) -> VerifierState:
        """Return the authentication state of a `sw_receiver`; if the library has no key, return the power-on state."""
        return self._read(VerifierState, receiver.verifier) if self._has_key else VerifierState()

    def _read(self, kind: type[T], place: Any, **given: Any) -> T:
        """Return a dataclass of the type `kind`. A field that is not in `given` gets the value of the member of `place`
        that has the same name; an array is copied as float64."""
        for item in fields(kind):  # type: ignore[arg-type]  # any dataclass
            if item.name not in given:
                value = getattr(place, item.name)
                value = self._array(value) if isinstance(value, self.ffi.CData) else value
                given[item.name] = bool(value) if item.type is bool else value
        return kind(**given)

    def _array(self, member: Any) -> Array:
        """Return a copy of an array with one or two dimensions, as float64."""
        shape, kind = list[int](), self.ffi.typeof(member)
        while kind.kind == "array":
            shape.append(kind.length)
            kind = kind.item
        return np.frombuffer(self.ffi.buffer(member), dtype=_NUMBERS[kind.cname]).astype(np.float64).reshape(shape)

    def set_state(self, pointer: Any, value: EcuState) -> None:
        """Fill in a `sw_ecu_state`. Counts saturate. A library without a key has no state of authentication."""
        self.ffi.buffer(pointer)[:] = bytes(self.ffi.sizeof("sw_ecu_state"))
        state, memory, sensors = pointer[0], value.memory, value.sensors
        commands, statuses, has = value.commands.counter, value.statuses.counter, value.pressure_ns is not None
        self._fill(state, value, command_counter=commands, status_counter=statuses, has_pressures=has)
        frozen, actions = len(memory.under_way.pending), list(memory.under_way.values)
        self._fill(state.memory, memory, plan=memory.plan.astype(np.float32), frozen=frozen, under_way=actions)
        judged, has_read = not np.isnan(sensors.residual).any(), not np.isnan(sensors.readings).any()
        self._fill(
            state.sensors,
            sensors,
            set_aside=-1 if sensors.set_aside is None else sensors.set_aside,
            judged=judged,
            has_read=has_read,
            flat=np.minimum(sensors.flat, _MOST).astype(np.uint32),
            residual=sensors.residual if judged else None,
            readings=sensors.readings if has_read else None,
        )
        self._fill(state.fail_safe, value.fail_safe, mode=_MODES.index(value.fail_safe.mode))
        self._fill(state.timing, value.timing, has_step=value.timing.step_ns is not None)
        self._fill(state.other_ecu, value.other_ecu, is_there=value.other_ecu.until_ns is not None)
        self._fill(state.benefit, value.benefit)
        self._fill(state.health, value.health, is_bus_off=value.health.state is BusState.BUS_OFF)
        self._set_received(state.pressures, value.pressures, value.verifier)
        if self._has_key:
            self._fill(state.freshness, value.freshness)
        if memory.past is not None:
            self._fill(state.memory.past, memory.past)
        if self._serves_speeds:
            self._fill(state.speed, value.speed, known=value.speed.ratio is not None)
            self._set_received(state.speed.receiver, value.speed.receiver, value.speed.verifier)
            if hasattr(state.speed, "air"):
                self._fill(state.speed.air, value.speed.air)

    def _fill(self, place: Any, value: Any, **given: Any) -> None:
        """Write the fields of a dataclass, and the values in `given`, into the members of a struct with the same names.
        Omit values that are None and members that are structs. Limit a count or a time to its range in C."""
        values = {item.name: getattr(value, item.name) for item in fields(value)} | given
        for name, member in self.ffi.typeof(place).fields:
            content = values.get(name)
            if content is None or member.type.kind == "struct":
                continue
            if isinstance(content, np.ndarray):
                self.copy(getattr(place, name), content)
            elif (limits := _RANGES.get(member.type.cname)) is not None:
                setattr(place, name, min(max(content, limits[0]), limits[1]))
            else:
                setattr(place, name, content)

    def _set_received(self, receiver: Any, value: ReceiverState, verifier: VerifierState) -> None:
        stream, has_counter = _STREAMS.index(value.stream), value.last_counter is not None
        window, counts = [item.value for item in value.window], [min(item, _MOST) for item in value.counts]
        self._fill(
            receiver, value, stream=stream, has_counter=has_counter, checks=len(window), window=window, counts=counts
        )
        if self._has_key:
            self._fill(receiver.verifier, verifier)

    def leaves(self, kind: Any, name: str = "", offset: int = 0) -> Iterator[Leaf]:
        """Yield the numbers and the arrays of numbers in a struct; `kind` is the struct's type in cffi."""
        if kind.kind == "array" and kind.item.kind == "struct":
            size = self.ffi.sizeof(kind.item)
            for index in range(kind.length):
                yield from self.leaves(kind.item, f"{name}[{index}]", offset + index * size)
        elif kind.kind == "struct":
            for part, item in kind.fields:
                yield from self.leaves(item.type, f"{name}.{part}" if name else part, offset + item.offset)
        else:
            yield Leaf(name, offset, offset + self.ffi.sizeof(kind), kind)

    def differing(self, found: Any, expected: EcuState) -> list[str]:
        """Return the names of the numbers that differ between a `sw_ecu_state` and `expected`, bit for bit."""
        place = self.ffi.new("sw_ecu_state *")
        self.set_state(place, expected)
        one, other = (bytes(self.ffi.buffer(self.ffi.addressof(item))) for item in (found, place[0]))
        leaves = self.leaves(self.ffi.typeof(place[0]))
        return [leaf.name for leaf in leaves if one[leaf.begin : leaf.end] != other[leaf.begin : leaf.end]]

    def copy(self, member: Any, values: Array) -> None:
        """Copy an array's bytes into a member of the same shape and type."""
        content = np.ascontiguousarray(values)
        assert content.nbytes == self.ffi.sizeof(member)
        self.ffi.memmove(member, content, content.nbytes)


def fill_frame(place: Any, frame: Frame) -> None:
    """Fill in a `sw_frame`. A time out of C's range is replaced by the nearest time in this range."""
    place.timestamp_ns = c_time(frame.timestamp_ns)
    place.id, place.is_extended, place.is_fd = frame.frame_id, frame.is_extended, frame.is_fd
    place.length = len(frame.data)
    place.data[0 : len(frame.data)] = frame.data


def _received(receiver: Any) -> ReceiverState:
    counter = receiver.last_counter if receiver.has_counter else None
    window = tuple(map(FrameCheck, list(receiver.window)[: receiver.checks]))
    stream, counts = _STREAMS[receiver.stream], tuple(receiver.counts)
    return ReceiverState(stream=stream, last_counter=counter, window=window, counts=counts)


def c_time(value: int) -> int:
    """Limit a time to the range of times in C; only a wrong clock gives a time outside this range."""
    least, most = _RANGES["int64_t"]
    return max(least, min(value, most))
