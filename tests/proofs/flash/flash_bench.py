"""A vehicle, an ECU that can be flashed, and a tester on one simulated bus, in virtual time; how long a flash takes.

The vehicle samples once a control period, and the ECU steps a fixed time after it. Between the steps ECU and tester
look at what is for them `SERVICE_NS` after a frame of diagnosis, as processes do that are woken by frames. Time passes
only while someone waits for it (`advance`).
"""

from collections.abc import Callable, Sequence
from typing import Any, Final

import numpy as np
from udsoncan.client import Client
from udsoncan.exceptions import TimeoutException

from can_bridge.bus.faults.fault import Fault
from can_bridge.bus.faults.wrapping import wrap
from can_bridge.bus.interface import Bus
from can_bridge.bus.simulated.medium import SimulatedBus
from can_bridge.bus.simulated.port import SimulatedPort
from can_bridge.isotp.endpoint import Endpoint
from can_bridge.tester.asking import KeyOf
from can_bridge.tester.sequence import Flashed, flash
from can_bridge.uds.services import REQUEST_ID, RESPONSE_ID
from can_bridge.wire.frame import Frame
from can_bridge.wire.message_sets import message_set
from can_bridge.wire.messages import EcuStatus
from contract import sensors
from contract.config.tree import Config
from contract.errors import BusError
from firmware_sim.bench.vehicle_node import VehicleNode
from firmware_sim.ecu.flashable.diagnostic_link import isotp_settings
from firmware_sim.ecu.flashable.flashable_ecu import FlashableEcu, is_diagnostic
from tests.can_bridge.tester.direct_connection import DirectConnection

SERVICE_NS: Final = 1_000_000
"""From a frame to its being looked at, by the ECU and by the tester."""
STEP_OFFSET_NS: Final = 4_000_000
"""From the sampling of pressures to the control step, as `ecu.step_offset_ms` is by default."""
_ROOM: Final = 16
"""Frames that wait for the bus from which on a node gives it no more."""
_DIAGNOSTIC: Final = frozenset({REQUEST_ID, RESPONSE_ID})
_AMPLITUDE_CP: Final = 0.3
_SENSORS: Final = ("upper_39", "lower_39", "base_0", "base_9")


class FlashBench:
    """Everything at time 0.

    Args:
        ecu: just powered on.
        config: of the vehicle; the bit rates are the bus's.
        losses: faults of the tester's connection, both ways, and their seed.
        request: whether the vehicle asks for control at a time in ns.

    Attributes:
        bus: all three are on.
        periods, diagnostic_frames: control steps and frames of diagnosis so far.
        status: the ECU's latest; None before the first.
        largest_flow: largest |flow| commanded with the jets enabled so far, in m2/s.
    """

    def __init__(
        self,
        ecu: FlashableEcu,
        config: Config,
        *,
        losses: Sequence[Fault] = (),
        seed: int = 0,
        request: Callable[[int], bool] = lambda now_ns: False,
    ) -> None:
        self.bus = SimulatedBus(config.bus, self._heard)
        self.ecu = ecu
        self._config, self._request = config, request
        self._messages = message_set(config.bus)
        self._vehicle = VehicleNode(_SENSORS, config)
        self._vehicle_port, self._ecu_port = self.bus.port("vehicle"), self.bus.port("ecu")
        self._tester_port = self.bus.port("tester")
        self._tester: Bus = wrap(self._tester_port, losses, lambda: self.bus.now_ns, seed=seed)
        self._endpoint = Endpoint(isotp_settings(config.bus, receive_id=RESPONSE_ID, send_id=REQUEST_ID))
        self._answers: list[bytes] = []
        self._for_control: list[Frame] = []
        self._for_service: list[Frame] = []
        self._looks = False
        self.periods = self.diagnostic_frames = 0
        self.status: EcuStatus | None = None
        self.largest_flow = 0.0
        self._period()

    def advance(self, seconds: float, stop: Callable[[], bool] = lambda: False) -> bool:
        """Let time pass, up to so much or until `stop()`; whether it was."""
        return self.bus.advance_until(self.bus.now_ns + round(seconds * 1e9), stop)

    def ask(self, payload: bytes) -> None:
        """Have the tester send a request."""
        self._endpoint.send(payload)
        self._look_soon()

    def answer(self, seconds: float) -> bytes | None:
        """The next answer to the tester, None if none comes in so long."""
        if self._answers or self.advance(seconds, lambda: bool(self._answers)):
            return self._answers.pop(0)
        return None

    def forget_answers(self) -> None:
        """Drop what came before."""
        self._answers.clear()

    # What happens on the bus.

    def _period(self) -> None:
        now_ns = self.bus.now_ns
        phase = 0.25 * self.periods
        cp = _AMPLITUDE_CP * np.sin(phase + np.arange(sensors.COUNT))
        self._hear_ecu()
        self._send(self._vehicle_port, [self._vehicle.sample(cp, enable_request=self._request(now_ns), now_ns=now_ns)])
        # Time alone ends what waits for a frame that was lost.
        self._look_soon()
        self.bus.call_at(now_ns + STEP_OFFSET_NS, self._step)
        self.bus.call_at(now_ns + self._config.period_ns, self._period)

    def _hear_ecu(self) -> None:
        for frame in self._vehicle_port.receive_all():
            if self._messages.status.spec.names(frame):
                self.status = self._messages.status.parse(frame.data[: self._messages.status.spec.protected])
            elif self._messages.command.spec.names(frame):
                command = self._messages.command.parse(frame.data[: self._messages.command.spec.protected])
                if command is not None and command.enable:
                    self.largest_flow = max(self.largest_flow, abs(command.flow_m2_per_s))

    def _step(self) -> None:
        self._sort()
        frames, self._for_control = self._for_control, []
        self._send(self._ecu_port, self.ecu.control(self.bus.now_ns, frames, self._ecu_port.health()))
        self.periods += 1

    def _heard(self, frame: Frame) -> None:
        if frame.frame_id in _DIAGNOSTIC:
            self.diagnostic_frames += 1
            self._look_soon()

    def _look_soon(self) -> None:
        if not self._looks:
            self._looks = True
            self.bus.call_at(self.bus.now_ns + SERVICE_NS, self._look)

    def _sort(self) -> None:
        received = self._ecu_port.receive_all()
        self._for_control += [frame for frame in received if not is_diagnostic(frame)]
        self._for_service += [frame for frame in received if is_diagnostic(frame)]

    def _serve(self) -> None:
        self._sort()
        if len(self._ecu_port.queue) < _ROOM:
            frames, self._for_service = self._for_service, []
            self._send(self._ecu_port, self.ecu.service(self.bus.now_ns, frames))

    def _look(self) -> None:
        self._looks = False
        self._serve()
        now_ns = self.bus.now_ns
        for frame in self._tester.receive_all():
            self._endpoint.receive(now_ns, frame)
        sent: list[Frame] = []
        if len(self._tester_port.queue) < _ROOM:
            sent = self._endpoint.poll(now_ns)
            self._send(self._tester, sent)
        self._answers += self._endpoint.take()
        if sent or self.ecu.is_busy:
            self._look_soon()

    @staticmethod
    def _send(port: Bus | SimulatedPort, frames: Sequence[Frame]) -> None:
        for frame in frames:
            try:
                port.send(frame)
            except BusError:
                return


class BenchConnection(DirectConnection):
    """udsoncan's connection to the ECU on the bench: while its client waits for an answer, virtual time passes."""

    def __init__(self, bench: FlashBench) -> None:
        super().__init__()
        self._bench = bench

    def empty_rxqueue(self) -> None:
        """Drop late answers to earlier requests."""
        self._bench.forget_answers()

    def specific_send(self, payload: bytes, timeout: float | None = None) -> None:
        """Hand a request over."""
        self._bench.ask(payload)

    def specific_wait_frame(self, timeout: float | None = None) -> Any:
        """The next answer; raises TimeoutException if none comes in so long."""
        answer = self._bench.answer(2.0 if timeout is None else timeout)
        if answer is None:
            raise TimeoutException(f"no answer within {timeout} s of virtual time")
        return answer


def flash_on(bench: FlashBench, image: bytes, *, key: KeyOf) -> Flashed:
    """Run the tester's sequence, that of `stillwake flash`, in the bench's time; raises FlashError."""

    def sleep(seconds: float) -> None:
        bench.advance(seconds)

    with Client(BenchConnection(bench)) as client:
        return flash(client, image, key=key, clock=lambda: bench.bus.now_ns / 1e9, sleep=sleep)
