"""Damaged and made-up receptions through the whole receive path, with genuine frames between them.

The path goes from what a backend hears to a parsed message, without a socket, port or clock. The backends are the real
ones; only the system's call that would hand over a datagram or bytes is ours.
"""

from collections import Counter, deque
from collections.abc import Iterator, Sequence
from itertools import count
from operator import attrgetter
from queue import SimpleQueue
from random import Random
from types import SimpleNamespace
from typing import Any, Final

import can
import msgpack  # type: ignore[import-untyped]  # ships none
from can.interfaces.udp_multicast.utils import pack_message

from benchmarks.common.command_line import track
from can_bridge.bus.backends.python_can import PythonCanBus
from can_bridge.bus.backends.slcan import LINE_LIMIT, SlcanBus
from can_bridge.bus.backends.udp_multicast import UdpMulticastBus
from can_bridge.bus.conversion import to_message
from can_bridge.bus.interface import Rejection
from can_bridge.e2e.profiles import E2eSender
from can_bridge.e2e.receiver import E2eReceiver
from can_bridge.secoc.key import KEY_LENGTH, Key
from can_bridge.secoc.securing import Freshness, VerifierState, secured, verified
from can_bridge.wire.frame import Frame
from can_bridge.wire.message_sets import CLASSIC, FD, SECURED
from can_bridge.wire.message_specs import MessageSpec
from contract.config.vehicle import E2eConfig
from tests.can_bridge.bus.backends.peers import ScriptedBus
from tests.proofs.command_line import max_rss_kib
from tests.proofs.release import damage

BATCH: Final = 50  # receptions between two collections, a tenth of them genuine
GENUINE: Final = 5
MESSAGES: Final = [
    message for used in (FD, CLASSIC, SECURED) for message in (used.pressure, used.speed, used.command, used.status)
]
KEY: Final = Key(bytes(range(KEY_LENGTH)))
_content: Final = attrgetter("frame_id", "data", "is_fd")


class ReceivePath:
    """One node for each backend; each call feeds one of them sound frames, made-up ones between them, and follows what
    comes out to its end. `authentic` are the frames of secured messages that came as far as their end-to-end check; the
    caller may clear it."""

    def __init__(self) -> None:
        self._datagrams, self._port, self._messages = _FedUdpBus(), _FedPort(), ScriptedBus([])
        self._lines = _FedSlcanBus(self._port)
        self._udp, self._slcan = PythonCanBus(self._datagrams), PythonCanBus(self._lines)
        self._driver = PythonCanBus(self._messages, linux_error_frames=True)
        self.buses = (self._udp, self._slcan, self._driver)
        self._messages_in = [(E2eReceiver(message.spec, E2eConfig()), message.parse) for message in MESSAGES]
        self._verifiers = {message.spec: VerifierState() for message in MESSAGES if message.spec.is_secured}
        self.authentic: list[Frame] = []
        self._time = 0.0

    def datagrams(self, rng: Random, sound: list[Frame]) -> list[Frame]:
        packed = [pack_message(to_message(frame)) for frame in sound]
        made_up = [any_datagram(rng, rng.choice(packed)) for _ in range(BATCH - GENUINE)]
        for content in _mixed(rng, packed, made_up):
            self._time += 1.0  # so that none passes for another's copy
            self._datagrams.waiting.append((content, ("127.0.0.1", 1), self._time))
        return self._followed(self._udp, len(self._datagrams.waiting))

    def lines(self, rng: Random, sound: list[Frame]) -> list[Frame]:
        genuine = [_line(frame) for frame in sound]
        made_up = [any_line(rng, rng.choice(genuine)) for _ in range(BATCH - GENUINE)]
        # A line without its end would take the next one with it: on a serial line that is so.
        for item in _mixed(rng, genuine, made_up):
            self._port.waiting += b"\r" + item if item in genuine else item
        frames = self._followed(self._slcan)
        if self._port.waiting or len(self._lines._buffer) > LINE_LIMIT:
            raise AssertionError("serial bytes were left over")
        return frames

    def messages(self, rng: Random, sound: list[Frame]) -> list[Frame]:
        made_up = [any_message(rng) for _ in range(BATCH - GENUINE)]
        self._messages.script.extend(_mixed(rng, [to_message(frame) for frame in sound], made_up))
        return self._followed(self._driver, len(self._messages.script))

    def _followed(self, bus: PythonCanBus, fed: int | None = None) -> list[Frame]:
        """All frames that came, after end-to-end check and parser; AssertionError where the books do not balance. `fed`
        receptions went in; None for serial lines, whose number is a matter of their ends."""
        before, received = bus.accepted, -1
        expected = None if fed is None else bus.received + fed
        frames: list[Frame] = []
        while bus.received != received:
            received = bus.received
            frames += bus.receive_all()
        if len(frames) != bus.accepted - before or bus.received != bus.accepted + sum(bus.rejected.values()):
            raise AssertionError(f"{bus.received} received: {bus.accepted} accepted, {bus.rejected} refused")
        if expected not in (None, bus.received):
            raise AssertionError(f"{bus.received} received, {expected} went in")
        for receiver, parse in self._messages_in:
            spec = receiver.spec
            accepted = receiver.tick(self._authenticated(frames, spec)).accepted
            if accepted is not None:
                parse(accepted.data[: spec.protected])
            for frame in frames:
                # Damaged content must not harm a parser either, were it to pass the check.
                if frame.frame_id == spec.frame_id:
                    parse(frame.data)
                    parse(frame.data[: spec.protected])
        return frames

    def _authenticated(self, frames: list[Frame], spec: MessageSpec) -> Sequence[Frame]:
        if spec not in self._verifiers:
            return frames
        self._verifiers[spec], passed, _ = verified(self._verifiers[spec], frames, spec=spec, key=KEY)
        self.authentic += [frame for frame in passed if frame.frame_id == spec.frame_id and not frame.is_extended]
        return passed


class _FedUdpBus(UdpMulticastBus):
    def __init__(self) -> None:
        can.BusABC.__init__(self, "fed")
        self.waiting: deque[tuple[bytes, tuple[str, int], float]] = deque()
        socket: Any = SimpleNamespace(recv=lambda timeout: self.waiting.popleft() if self.waiting else None)
        self._multicast = socket
        self._can_protocol = can.CanProtocol.CAN_FD
        self._remember_nothing()
        can.BusABC.shutdown(self)  # nothing to close: python-can would remind us of it


class _FedPort:
    """A stand-in for pyserial's port."""

    is_open = True

    def __init__(self) -> None:
        self.waiting = bytearray()

    @property
    def in_waiting(self) -> int:
        return len(self.waiting)

    def read(self, size: int) -> bytes:
        content = bytes(self.waiting[:size])
        del self.waiting[:size]
        return content


class _FedSlcanBus(SlcanBus):
    def __init__(self, port: _FedPort) -> None:
        can.BusABC.__init__(self, "fed")
        self.serialPortOrig = port
        self._buffer, self._queue = bytearray(), SimpleQueue[str]()
        can.BusABC.shutdown(self)


def measure(*, frames: int = 300_000, seed: int = 0) -> dict[str, Any]:
    """Feed datagrams, serial lines and drivers' messages in turn, a tenth of them genuine and the others made up.

    `fuzz_frames` are receptions as the buses counted them (noise on a serial line may hold several). Of the `authentic`
    secured frames, `authentic_made_up` were sent by no one. Memory grows by `max_rss_growth_kib` after the first tenth.
    """
    rng, path, genuine, batches = Random(seed), ReceivePath(), _genuine_frames(), -(-frames // BATCH)
    lost = authentic = made_up = 0
    failures: list[str] = []
    rss_before = 0
    for batch in track(range(batches), "fuzz", f"batches of {BATCH}"):
        sound = [next(genuine) for _ in range(GENUINE)]
        try:
            got = (path.datagrams, path.lines, path.messages)[batch % 3](rng, sound)
        except Exception as error:  # noqa: BLE001 - what this looks for
            failures.append(f"batch {batch} of seed {seed}: {error!r}")
            got = []
        # As often as it was sent: a copy of a genuine frame is a frame of its own.
        arrived = Counter(map(_content, got))
        lost += (Counter(map(_content, sound)) - arrived).total()
        authentic += len(path.authentic)
        # What is made up is made from this batch's frames: no other authentic content can be in it.
        made_up += len({frame.data for frame in path.authentic} - {frame.data for frame in sound})
        path.authentic.clear()
        if batch == batches // 10:  # until then memory fills with what is kept
            rss_before = max_rss_kib()
    rejected = {reason.value: sum(bus.rejected[reason] for bus in path.buses) for reason in Rejection}
    return {
        "fuzz_frames": sum(bus.received for bus in path.buses),
        "accepted": sum(bus.accepted for bus in path.buses),
        "rejected": {reason: count for reason, count in rejected.items() if count},
        "genuine": batches * GENUINE,
        "genuine_lost": lost,
        "authentic": authentic,
        "authentic_made_up": made_up,
        "exceptions": len(failures),
        "failures": failures[:10],
        "max_rss_growth_kib": max_rss_kib() - rss_before,
    }


def _genuine_frames() -> Iterator[Frame]:
    """Every message of the three sets in turn, for ever; the secured ones under `KEY`."""
    senders = [(E2eSender(message.spec), bytes(message.spec.protected)) for message in MESSAGES]
    for number in count():
        for sender, data in senders:
            frame, key = sender.frame(data, now_ns=number), KEY if sender.spec.is_secured else None
            yield secured(frame, spec=sender.spec, key=key, freshness=Freshness(count=number))


def _mixed(rng: Random, genuine: list[Any], made_up: list[Any]) -> list[Any]:
    """Both, the genuine ones in their order."""
    rest, total = iter(made_up), len(genuine) + len(made_up)
    at = dict(zip(sorted(rng.sample(range(total), len(genuine))), genuine, strict=True))
    return [at[place] if place in at else next(rest) for place in range(total)]


def _line(frame: Frame) -> bytes:
    code = can.util.len2dlc(len(frame.data))
    return f"{'b' if frame.is_fd else 't'}{frame.frame_id:03X}{code:X}{frame.data.hex().upper()}\r".encode()


_BAD_LINES: Final = (
    *(b"tzzz1AA\r", b"t\r", b"t12\r", b"b12\xff\xfe\r", b"t1231A\r", b"t1238AA\r", b"r1208\r", b"T000001201AA\r"),
    b"\a",
)
_FIELDS: Final = (
    *("arbitration_id", "data", "dlc", "is_extended_id", "is_remote_frame", "is_error_frame", "is_fd"),
    *("bitrate_switch", "error_state_indicator", "channel", "surprise"),
)


def odd_value(rng: Random) -> Any:
    """A value of any type that a datagram can hold."""
    numbers = (rng.randrange(0x800), rng.randrange(-(2**63), 2**64), rng.uniform(-1e9, 1e9), float("nan"))
    others = (None, rng.random() < 0.5, "x" * rng.randrange(5), rng.randbytes(rng.randrange(70)))
    return rng.choice((*numbers, *others, [1, 2], {}))


def any_datagram(rng: Random, sound: bytes) -> bytes:
    kind = rng.randrange(4)
    if kind == 0:
        return rng.randbytes(rng.randrange(200))
    if kind == 1:
        return damage.bytes_of(rng, sound)
    fields = msgpack.unpackb(sound)
    for _ in range(rng.randrange(1, 3)):
        fields[rng.choice(_FIELDS)] = odd_value(rng)
    if kind == 2:
        fields.pop(rng.choice(list(fields)))
    packed: bytes = msgpack.packb(fields)
    return packed


def any_line(rng: Random, sound: bytes) -> bytes:
    kind = rng.randrange(4)
    if kind == 0:
        return rng.randbytes(rng.randrange(40)) + b"\r"
    if kind == 1:
        return damage.bytes_of(rng, sound)
    if kind == 2:
        return rng.choice(_BAD_LINES)
    digits = "".join(rng.choices("0123456789ABCDEF", k=rng.randrange(150)))
    return (rng.choice("tTdDbBrRxzVN") + digits).encode() + rng.choice((b"\r", b"\a", b""))


def any_message(rng: Random) -> can.Message:
    fields: dict[str, Any] = {
        "arbitration_id": rng.randrange(0x800) if rng.random() < 0.8 else rng.randrange(2**32),
        "is_extended_id": rng.random() < 0.2,
        "is_remote_frame": rng.random() < 0.1,
        "is_error_frame": rng.random() < 0.1,
        "is_fd": rng.random() < 0.5,
        "data": rng.randbytes(rng.choice((0, 7, 8, 8, 12, 16, 24, 32, 64, rng.randrange(70)))),
        "timestamp": rng.choice((0.0, 1.5, -1.0, float("nan"), float("inf"), 1e300)),
    }
    if rng.random() < 0.3:
        fields["dlc"] = rng.randrange(70)
    if rng.random() < 0.1:
        fields[rng.choice(("arbitration_id", "is_fd", "dlc", "timestamp"))] = odd_value(rng)
    return can.Message(**fields)
