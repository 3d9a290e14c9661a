"""The endpoint and the library can-isotp as the two ends of a connection, without a clock: each has its turn."""

from collections import deque
from collections.abc import Callable
from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from can_bridge.isotp.endpoint import Endpoint, IsoTpSettings
from can_bridge.wire.frame import Frame
from tests.examples import examples

isotp = pytest.importorskip("isotp")

TESTER, ECU = 0x7E0, 0x7E8
FD = IsoTpSettings(receive_id=TESTER, send_id=ECU)
CLASSIC = replace(FD, is_fd=False, frame_length=8)
SHORT_FD = replace(FD, frame_length=16)
SETTINGS = (CLASSIC, FD, SHORT_FD)


class Connection:
    """Both ends, and what the wire does to frames."""

    def __init__(
        self, settings: IsoTpSettings, *, on_wire: Callable[[Frame], list[Frame]] = lambda frame: [frame], **parameters
    ) -> None:
        self.ecu = Endpoint(settings)
        self.on_wire = on_wire
        self.to_tester: deque[Frame] = deque()
        self.errors: list[Exception] = []
        self.now_ns = 0
        self.tester = isotp.TransportLayerLogic(
            rxfn=self._to_tester,
            txfn=self._from_tester,
            address=isotp.Address(isotp.AddressingMode.Normal_11bits, txid=TESTER, rxid=ECU),
            error_handler=self.errors.append,
            params={
                "stmin": 0,
                "blocksize": 0,
                "can_fd": settings.is_fd,
                "tx_data_length": settings.frame_length,
                "tx_padding": 0xCC,
                "wftmax": 10,
                # can-isotp measures these by the wall clock.
                "rx_flowcontrol_timeout": 600_000,
                "rx_consecutive_frame_timeout": 600_000,
                **parameters,
            },
        )

    def _to_tester(self, timeout):
        if not self.to_tester:
            return None
        frame = self.to_tester.popleft()
        return isotp.CanMessage(arbitration_id=frame.frame_id, data=frame.data, is_fd=frame.is_fd)

    def _from_tester(self, message):
        for frame in self.on_wire(
            Frame(frame_id=message.arbitration_id, data=bytes(message.data), is_fd=message.is_fd)
        ):
            self.ecu.receive(self.now_ns, frame)

    def turn(self) -> bool:
        """Both ends once; whether any frame went."""
        sent = self.tester.process().sent
        frames = [each for frame in self.ecu.poll(self.now_ns) for each in self.on_wire(frame)]
        self.to_tester += frames
        return bool(sent or frames)

    def run(self) -> None:
        while self.turn():
            pass


def exchange(connection: Connection, length: int) -> None:
    """A message of this length in both directions at once."""
    request, response = bytes(i * 7 % 251 for i in range(length)), bytes(i * 11 % 241 for i in range(length))
    connection.tester.send(request)
    connection.ecu.send(response)
    connection.run()
    assert connection.ecu.take() == [request], length
    assert connection.tester.recv() == response, length
    assert connection.errors == []


def test_messages_of_every_length_and_block_size_arrive_whole():
    for settings in SETTINGS:
        connection = Connection(settings)
        lengths = range(1, 2 * settings.frame_length + 2)
        for length in (*lengths[:: 1 if settings.frame_length < 64 else 3], 62, 63, 64, 125, 126, 4094, 4095):
            exchange(connection, length)
        for block_size in (1, 7, 255):
            exchange(Connection(replace(settings, block_size=block_size), blocksize=block_size), 4095)


@examples(50)
@given(
    settings=st.sampled_from(SETTINGS),
    lengths=st.lists(st.integers(1, 400), min_size=1, max_size=4),
    faults=st.lists(st.sampled_from(["pass"] * 8 + ["lose", "double", "swap"]), max_size=200),
    both=st.booleans(),
)
@pytest.mark.slow
def test_of_lost_doubled_and_swapped_frames_only_whole_messages_come(settings, lengths, faults, both):
    """Frames change place with their neighbour. Sixteen places away the sequence number would not show it, nor would
    anything show a first frame that comes after that of the next message; no bus delays a frame so long."""
    coming, held = iter(faults), dict[int, Frame]()

    def on_wire(frame: Frame) -> list[Frame]:
        fault = next(coming, "pass")
        before = held.pop(frame.frame_id, None)
        if fault == "swap" and not before:
            held[frame.frame_id] = frame
            return []
        return {"lose": [], "double": [frame, frame]}.get(fault, [frame]) + ([before] if before else [])

    # The library's own timers would wait for real time, so it gives up at once between messages.
    connection = Connection(settings, on_wire=on_wire)
    sent, replies, answers = [], [], []
    for index, length in enumerate(lengths):
        sent.append(bytes((i + 50 * index) % 256 for i in range(length)))
        connection.tester.send(sent[-1])
        if both:
            replies.append(sent[-1][::-1])
            connection.ecu.send(replies[-1])
        connection.run()
        connection.tester.stop_sending()
        connection.tester.stop_receiving()
        connection.to_tester.clear()
        held.clear()
        connection.now_ns += 10**10
        connection.ecu.poll(connection.now_ns)
    while (answer := connection.tester.recv()) is not None:
        answers.append(bytes(answer))
    requests = connection.ecu.take()
    assert set(requests) <= set(sent) and set(answers) <= set(replies)
    if not set(faults) - {"pass"}:
        assert (requests, answers) == (sent, replies)
