"""A run of the ECU's FMU and the plant's FMU; frames pass through a simulated bus (docs/how-to/use-the-fmu.md).

stillwake export --fmu bus:ecu.fmu && stillwake plant-fmu plant.fmu && python examples/network_of_fmus.py
"""

import struct
from collections.abc import Callable, Iterator, Sequence
from ctypes import c_double, c_int, c_uint
from pathlib import Path
from typing import Any, Protocol

import numpy as np
from fmpy import extract, read_model_description
from fmpy.fmi3 import FMU3Slave
from rich import print

from can_bridge.bus.simulated.medium import SimulatedBus
from can_bridge.wire.frame import Frame
from can_bridge.wire.message_sets import message_set
from contract.arrays import Array
from contract.config.tree import Config
from firmware_sim.bench.vehicle_node import VehicleNode

CAN_TRANSMIT, FD_TRANSMIT = 0x10, 0x11
TERMINAL = "CanChannel"


class Body(Protocol):
    """A flow that returns the Cp of all its n sensors, (n,), and ramps its jets to an action over a control period."""

    def pressures(self) -> Array: ...
    def advance(self, action: float) -> None: ...


def opened(path: Path, *, events: bool = False) -> tuple[Any, dict[str, int]]:
    """Return an instantiated FMU, and the value references of its variables by their names."""
    about = read_model_description(str(path))
    fmu: Any = FMU3Slave(
        guid=about.instantiationToken,
        unzipDirectory=extract(str(path)),
        modelIdentifier=about.coSimulation.modelIdentifier,
        instanceName=path.stem,
    )
    fmu.instantiate(loggingOn=True, eventModeUsed=events)
    return fmu, {item.name: item.valueReference for item in about.modelVariables}


def operation(frame: Frame) -> bytes:
    """Return the operation by which a bus terminal transmits a frame, as bytes."""
    size, fd = len(frame.data), frame.is_fd
    head = struct.pack("<IIIB", 0x10 + fd, 16 + fd + size, frame.frame_id, frame.is_extended)
    return head + (b"\1\0" if fd else b"\0") + struct.pack("<H", size) + frame.data


def operations(data: bytes) -> Iterator[tuple[int, bytes]]:
    """Yield the code and the arguments of each operation in a terminal's data."""
    while data:
        code, length = struct.unpack_from("<II", data)
        yield code, data[8:length]
        data = data[length:]


def frames(data: bytes, now_ns: int) -> list[Frame]:
    """Return the frames that the operations in a terminal's data transmit."""
    found = []
    for code, content in operations(data):
        if code in (CAN_TRANSMIT, FD_TRANSMIT):
            frame_id, extended = struct.unpack_from("<IB", content)
            body, fd = content[8 + (code == FD_TRANSMIT) :], code == FD_TRANSMIT
            found.append(Frame(frame_id=frame_id, data=body, timestamp_ns=now_ns, is_fd=fd, is_extended=bool(extended)))
    return found


class TerminalNode:
    """An initialised FMU with a bus terminal. Each step ends at an event: frames arrive, or Tx_Clock ticks, next at the
    time `due_ns` in ns."""

    def __init__(self, path: Path, **parameters: float | bool) -> None:
        self.fmu, self.references = opened(path, events=True)
        self._now_ns = self.due_ns = 0
        self.begin(**parameters)

    def begin(self, **parameters: float | bool) -> None:
        """Initialise the FMU, for the first time or after a reset."""
        self._now_ns = 0
        for name, value in parameters.items():
            give = self.fmu.setBoolean if isinstance(value, bool) else self.fmu.setFloat64
            give([self.references[name]], [value])
        self.fmu.enterInitializationMode(startTime=0.0)
        self.fmu.exitInitializationMode()
        self._leave()

    def of(self, member: str) -> list[int]:
        return [self.references[f"{TERMINAL}.{member}"]]

    def event(self, now_ns: int, received: bytes = b"") -> bytes:
        """Step to the time `now_ns`, and pass the received data to the terminal. Return the terminal's data if Tx_Clock
        is due, otherwise no bytes."""
        now, size = self._now_ns / 1e9, (now_ns - self._now_ns) / 1e9
        self.fmu.doStep(currentCommunicationPoint=now, communicationStepSize=size)
        self.fmu.enterEventMode()
        self._now_ns, sent = now_ns, b""
        if received:
            self.fmu.setClock(self.of("Rx_Clock"), [True])
            self.fmu.setBinary(self.of("Rx_Data"), [received])
        if now_ns >= self.due_ns:
            self.fmu.setClock(self.of("Tx_Clock"), [True])
            sent = bytes(self.fmu.getBinary(self.of("Tx_Data"))[0])
        self.fmu.updateDiscreteStates()
        self._leave()
        return sent

    def _leave(self) -> None:
        interval, qualifier = (c_double * 1)(), (c_int * 1)()
        self.fmu.getIntervalDecimal((c_uint * 1)(*self.of("Tx_Clock")), interval, qualifier)
        self.due_ns = self._now_ns + round(interval[0] * 1e9)
        self.fmu.enterStepMode()


def run(
    ecu: TerminalNode,
    body: Body,
    vehicle: VehicleNode,
    config: Config,
    *,
    periods: int,
    asks: Callable[[int], bool],
    capture: Callable[[Frame], None],
) -> None:
    """Run control periods of vehicle and ECU on one simulated bus. `asks` returns whether the vehicle requests control
    in period k; `capture` is called with every frame on the bus."""
    bus, command = SimulatedBus(config.bus, capture), message_set(config.bus).command.spec
    at_vehicle, at_ecu = bus.port("vehicle"), bus.port("ECU")
    inbox: list[Frame] = []

    def came() -> bool:
        inbox.extend(at_ecu.receive_all())
        return bool(inbox)

    for k in range(periods):
        start_ns, end_ns = k * config.period_ns, (k + 1) * config.period_ns - 1
        bus.advance_to(start_ns)
        at_vehicle.send(vehicle.sample(body.pressures(), enable_request=asks(k), now_ns=start_ns))
        if (speed := vehicle.speed_frame(now_ns=start_ns)) is not None:
            at_vehicle.send(speed)
        while bus.now_ns < end_ns:
            bus.advance_until(min(max(ecu.due_ns, bus.now_ns), end_ns), came)
            if came() or bus.now_ns >= ecu.due_ns:
                received = b"".join(map(operation, inbox))
                inbox.clear()
                for frame in frames(ecu.event(bus.now_ns, received), bus.now_ns):
                    at_ecu.send(frame)
        body.advance(vehicle.apply_commands([item for item in at_vehicle.receive_all() if command.names(item)]).action)


class PlantFmu:
    """The plant's FMU with the interface of `Body`."""

    def __init__(self, path: Path, config: Config) -> None:
        self._fmu, self._references = opened(path)
        self._fmu.enterInitializationMode(startTime=0.0)
        self._fmu.exitInitializationMode()
        self._config, self._periods = config, 0
        self._pressures = [item for name, item in self._references.items() if name.startswith("pressure.")]

    def pressures(self) -> Array:
        return np.array(self._fmu.getFloat64(self._pressures)) / self._config.operating_point.dynamic_pressure

    def advance(self, action: float) -> None:
        period = self._config.period_ns / 1e9
        flow = action * self._config.operating_point.flow_rate_scale
        self._fmu.setFloat64([self._references["jet_flow"]], [flow])
        self._fmu.doStep(currentCommunicationPoint=self._periods * period, communicationStepSize=period)
        self._periods += 1

    def drag(self) -> float:
        return float(self._fmu.getFloat64([self._references["Cd"]])[0])


def main(sensors: Sequence[str], ecu: Path, plant: Path, *, lead_in: int, periods: int) -> list[float]:
    """Run vehicle, ECU and plant; return the drag coefficient of each period. Control is requested after `lead_in`
    periods."""
    config, drag = Config(), list[float]()
    body = PlantFmu(plant, config)

    def asks(k: int) -> bool:
        drag.append(body.drag())
        return k >= lead_in

    node = VehicleNode(sensors, config)
    run(TerminalNode(ecu), body, node, config, periods=periods, asks=asks, capture=lambda frame: None)
    return drag


if __name__ == "__main__":
    from stillwake.parts.releases import open_release

    found = main(open_release(None).manifest.sensors, Path("ecu.fmu"), Path("plant.fmu"), lead_in=70, periods=370)
    print(f"Cd {np.mean(found[:70]):.3f} without control, {np.mean(found[170:]):.3f} under control")
