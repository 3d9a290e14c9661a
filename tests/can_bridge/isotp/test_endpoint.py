"""The endpoint: frames as the standard's tables have them, written out by hand; and can-isotp as the other end."""

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
MS = 1_000_000


def raw(text: str) -> bytes:
    """Hexadecimal; `00x7` stands for seven such bytes."""
    parts = (part.partition("x") for part in text.split())
    return b"".join(bytes.fromhex(byte) * int(count or 1) for byte, _, count in parts)


def play(settings: IsoTpSettings, story: str) -> None:
    """Steps, separated by semicolons.

    `at`: milliseconds; `hear`: a frame comes; `send`: a message of ours; `says`: how the frames of one poll begin, all
    of them; `gives`: messages that came whole; `idle`.
    """
    endpoint, now_ns = Endpoint(settings), 0
    for step in story.split(";"):
        verb, _, rest = step.strip().partition(" ")
        listed = [raw(each) for each in rest.split(",")] if rest and verb in ("says", "gives") else []
        if verb == "at":
            now_ns = round(float(rest) * MS)
        elif verb == "hear":
            endpoint.receive(now_ns, Frame(frame_id=TESTER, data=raw(rest), is_fd=len(raw(rest)) > 8))
        elif verb == "send":
            endpoint.send(raw(rest))
        elif verb == "says":
            sent = endpoint.poll(now_ns)
            assert len(sent) == len(listed), (story, step, sent)
            assert all(a.data.startswith(b) for a, b in zip(sent, listed, strict=True)), (story, step, sent)
        elif verb == "gives":
            assert endpoint.take() == listed, (story, step)
        else:
            assert (verb, endpoint.poll(now_ns), endpoint.take()) == ("idle", [], []), (story, step)


def test_messages_and_flow_control():
    for settings, story in (
        (CLASSIC, "hear 02 3E 80 CCx5; gives 3E 80; send 7E 00; says 02 7E 00 CCx5; idle"),
        # Our own block size and separation time.
        (
            replace(CLASSIC, block_size=2, separation_code=0xF3),
            "hear 10 1B 00x6; says 30 02 F3 CCx5; hear 21 00x7; says; hear 22 00x7; says 30 02 F3; hear 23 00x7;"
            "gives 00x27; says",
        ),
        # The other end's block size.
        (
            CLASSIC,
            "send 00 01 02 03 04 05 06x28; says 10 22 00 01 02 03 04 05; says; hear 30 03 00; says 21, 22, 23; says;"
            "hear 30 00 00; says 24; idle",
        ),
        # The first frame of a block need not wait.
        (CLASSIC, "send 00x20; says 10; hear 30 01 7F; says 21; at 0.001; hear 30 01 7F; says 22"),
        # Waits are obeyed and counted, again in each block and each message.
        (
            replace(CLASSIC, max_waits=2),
            "send 00x20; says 10; at 900; hear 31 00 00; says; at 1800; hear 31 00 00; says; at 2700; hear 30 01 00;"
            "says 21; at 3600; hear 31 00 00; at 4500; hear 31 00 00; hear 30 00 00; says 22; idle;"
            "send 00x20; says 10; hear 31 00 00; hear 31 00 00; hear 31 00 00; idle;"
            "send 00x20; says 10; hear 31 00 00; hear 31 00 00; hear 30 00 00; says 21, 22; idle",
        ),
        # Overflow and reserved answers end a message, and the next one follows.
        *((CLASSIC, f"send 00x20; send 01; says 10; hear {code} 00 00; says 01 01") for code in (32, 33)),
        # Without flow control in time, and without the next frame in time.
        (CLASSIC, "send 00x20; says 10; at 1000; says; at 1000.001; says; idle; hear 30 00 00; says"),
        (CLASSIC, "hear 10 14 00x6; at 1000; hear 21 00x7; at 2000; hear 22 00x7; gives 00x20"),
        (CLASSIC, "hear 10 14 00x6; at 1000; hear 21 00x7; at 2000.001; hear 22 00x7; gives"),
        (CLASSIC, "hear 10 14 00x6; at 1001; says"),
        # A wrong sequence number, and a new message, end the one on the way.
        *((CLASSIC, f"hear 10 0A 00x6; hear 2{n:X} 00x7; hear 21 00x7; gives") for n in {*range(16)} - {1}),
        (CLASSIC, "hear 10 0A 00x6; hear 02 AA BB; hear 21 AA AA; gives AA BB"),
        (CLASSIC, "hear 10 0A 00x6; hear 10 08 AAx6; hear 21 AA AA; gives AAx8"),
        # Too long a message.
        (CLASSIC, "hear 10 00 00 00 10 00 00 00; says 32 00 00; hear 21 00x7; gives"),
        # Of frames on the way, a shorter one ends in nothing, and a longer one is ignored.
        (FD, "hear 10 80 00x62; hear 21 00x47; hear 22 00x63; hear 21 00x63; gives"),
        (FD, "hear 10 0A 00x6; hear 21 AAx11; gives; hear 21 00x7; gives 00x10"),
        (replace(CLASSIC, burst=2), "send 00x41; says 10; hear 30 00 00; says 21, 22; says 23, 24; says 25; says"),
    ):  # fmt: skip
        play(settings, story)


def test_the_others_separation_time_is_kept():
    reserved = dict.fromkeys(("80", "F0", "FA", "FF"), 127)
    for code, gap_ms in {"01": 1, "7F": 127, "F1": 0.1, "F9": 0.9, **reserved}.items():
        begun = f"send 00x20; says 10; hear 30 00 {code}; says 21"
        play(CLASSIC, f"{begun}; at {gap_ms - 1e-6}; says; at {gap_ms}; says 22")


def test_what_the_standard_ignores_is_ignored():
    for ignored in (
        *("", "00", "00x8", "08 00x7", "03 AA AA", "00 00 00x10", "00 0B 00x10", "05 05 00x10", "10 07 00x6"),
        *("10 0A 00", "10 3E 00x62", "10 00 00 00 00 0A 00 00", "30 00", "40 00 00", "F0 00 00"),
    ):
        play(FD, f"hear 10 0A 00x6; says 30; hear {ignored}; gives; says; hear 21 06x4; gives 00x6 06x4")
    endpoint = Endpoint(CLASSIC)
    for other in ({"frame_id": 0x7DF}, {"frame_id": ECU}, {"frame_id": TESTER, "is_extended": True}):
        endpoint.receive(0, Frame(data=b"\x01\x02", **other))  # type: ignore[arg-type]
    assert endpoint.take() == []


def test_queues_are_bounded():
    endpoint = Endpoint(replace(CLASSIC, queue=2))
    assert [endpoint.send(b"\x00") for _ in range(4)] == [True, True, False, False]
    for number in range(3):
        endpoint.receive(0, Frame(frame_id=TESTER, data=bytes([1, number])))
    assert endpoint.take() == [b"\x00", b"\x01"]
    assert len(endpoint.poll(0)) == 2
    for length in (0, 4096):
        with pytest.raises(ValueError, match=f"message has {length} bytes: must have 1..4095"):
            Endpoint(CLASSIC).send(bytes(length))


SETTINGS = (CLASSIC, FD, replace(FD, frame_length=16))


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
                **{"can_fd": settings.is_fd, "tx_data_length": settings.frame_length, "tx_padding": 0xCC},
                # can-isotp measures the timeouts by the wall clock.
                **dict.fromkeys(("rx_flowcontrol_timeout", "rx_consecutive_frame_timeout"), 600_000),
                **{"stmin": 0, "blocksize": 0, "wftmax": 10, **parameters},
            },
        )

    def _to_tester(self, timeout):
        if not self.to_tester:
            return None
        frame = self.to_tester.popleft()
        return isotp.CanMessage(arbitration_id=frame.frame_id, data=frame.data, is_fd=frame.is_fd)

    def _from_tester(self, message):
        sent = Frame(frame_id=message.arbitration_id, data=bytes(message.data), is_fd=message.is_fd)
        for frame in self.on_wire(sent):
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
