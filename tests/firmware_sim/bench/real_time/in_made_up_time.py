"""The vehicle's loop on a clock of the test's, with an ECU of the project's at the other end."""

from collections.abc import Callable, Iterator

from can_bridge.wire import codec
from can_bridge.wire.frame import Frame
from can_bridge.wire.message_specs import VEHICLE_SPEED
from can_bridge.wire.messages import Pressure
from contract.config.tree import Config
from contract.errors import BusError
from contract.sensors import TRUCK
from ecu.ecu import Ecu
from ecu.real_time.deadlines import Deadlines
from ecu.real_time.inbox import Inbox
from firmware_sim.bench.real_time.vehicle_loop import VehicleLoop
from firmware_sim.bench.vehicle_node import VehicleNode
from tests.firmware_sim.bench.harness import NAMES, Oscillator

FIRST_NS = 7_000_000_000


def pressure_in(frame: Frame) -> Pressure:
    """The content of a Pressure frame."""
    message = codec.parse_pressure(frame.data)
    assert message is not None
    return message


class LiveOscillator:
    """The plant of two numbers as a flow in real time; without pressures in the periods `late`."""

    layout = TRUCK
    description = "an oscillator"

    def __init__(self, substeps: int, late: frozenset[int] = frozenset()) -> None:
        self.plant, self.late, self.asked = Oscillator(substeps), late, -1
        self.driven: list[float] = []

    def sampled(self):
        self.asked += 1
        return None if self.asked in self.late else self.plant.sample().Cp

    def drive(self, action: float) -> None:
        self.driven.append(action)
        self.plant.advance_to(self.plant.substeps, action)


class MadeUpTime:
    """A vehicle's loop, an ECU that answers after `way_ns`, and the clock of both.

    Args:
        lateness: by how much each sleep ends late, ns; on time when used up.
        way_ns: from a pressure frame to its command's arrival, by the number of the frame.
    """

    def __init__(
        self,
        config: Config,
        ecu: Ecu | None,
        *,
        way_ns: Callable[[int], int] = lambda number: 9_000_000,
        lateness: Iterator[int] | None = None,
        late_flow: frozenset[int] = frozenset(),
        stage_times=None,
    ) -> None:
        self.now_ns, self.ecu, self.way_ns = 0, ecu, way_ns
        self.lateness = iter(()) if lateness is None else lateness
        self.config = config
        self.sent: list[tuple[int, Frame]] = []
        self.speeds: list[Frame] = []
        self.arriving: list[tuple[int, Frame]] = []
        self.is_taking = True
        self.flow = LiveOscillator(config.flow.substeps, late_flow)
        self.node = VehicleNode(NAMES, config)
        self.inbox = Inbox(lambda frame: self.now_ns, room=4096)
        self.loop = VehicleLoop(
            config,
            self.node,
            self.flow,
            self.send,
            self.inbox,
            Deadlines(period_ns=config.period_ns, due_ns=FIRST_NS, grace_ns=config.period_ns // 2),
            stage_times=stage_times,
            now_ns=lambda: self.now_ns,
            sleep_until=self.sleep_until,
        )

    def sleep_until(self, due_ns: int) -> None:
        self.pass_until(max(due_ns, self.now_ns) + next(self.lateness, 0))

    def pass_until(self, until_ns: int) -> None:
        """Let time pass, and what is on its way arrive."""
        self.arriving.sort(key=lambda item: item[0])
        while self.arriving and self.arriving[0][0] <= until_ns:
            self.now_ns, frame = self.arriving.pop(0)
            self.inbox.put(frame)
        self.now_ns = until_ns

    def send(self, frame: Frame) -> None:
        if not self.is_taking:
            raise BusError("frame 0x120 was not sent: made up")
        if VEHICLE_SPEED.names(frame):
            self.speeds.append(frame)
            return
        number = len(self.sent)
        self.sent.append((self.now_ns, frame))
        if self.ecu is not None:
            # The speed comes behind the pressures, and so is of the period before.
            answers = self.ecu.step(self.now_ns, [*self.speeds[-1:], frame])
            self.arriving += [(self.now_ns + self.way_ns(number), item) for item in answers]

    def run(self, periods: int, *, request_from: int = 1) -> None:
        for k in range(periods):
            self.loop.period(enable_request=k >= request_from)

    @property
    def instants(self) -> list[int]:
        """When pressures went out, in periods after the first instant, rounded down."""
        return [(at - FIRST_NS) // self.config.period_ns for at, _ in self.sent]
