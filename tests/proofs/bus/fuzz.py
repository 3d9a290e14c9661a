"""Damaged and made-up receptions through the whole receive path, with genuine frames between them."""

from collections import Counter
from collections.abc import Iterator
from itertools import count
from random import Random
from typing import Any, Final

import can
import msgpack  # type: ignore[import-untyped]  # ships none
from can.interfaces.udp_multicast.utils import pack_message

from benchmarks.common.command_line import track
from can_bridge.bus.conversion import to_message
from can_bridge.e2e.sender import E2eSender
from can_bridge.secoc.node import secured
from can_bridge.secoc.securing import Freshness
from can_bridge.wire.frame import Frame
from tests.proofs.bus.receive_path import KEY, MESSAGES, ReceivePath
from tests.proofs.command_line import max_rss_kib
from tests.proofs.release import damage

BATCH: Final = 50
"""Receptions between two collections, a tenth of them genuine."""
GENUINE: Final = 5
WARM_UP: Final = 0.1
"""Share of the frames before memory is looked at for the first time: until then it fills what it keeps."""


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
            got = (_datagrams, _lines, _messages)[batch % 3](rng, path, sound)
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
        if batch == int(WARM_UP * batches):
            rss_before = max_rss_kib()
    accepted, rejected = path.totals()
    return {
        "fuzz_frames": sum(bus.received for bus in path.buses),
        "accepted": accepted,
        "rejected": {reason.value: count for reason, count in rejected.items() if count},
        "genuine": batches * GENUINE,
        "genuine_lost": lost,
        "authentic": authentic,
        "authentic_made_up": made_up,
        "exceptions": len(failures),
        "failures": failures[:10],
        "max_rss_growth_kib": max_rss_kib() - rss_before,
    }


def _content(frame: Frame) -> tuple[int, bytes, bool]:
    return frame.frame_id, frame.data, frame.is_fd


def _genuine_frames() -> Iterator[Frame]:
    """Every message of the three sets in turn, for ever; the secured ones under `KEY`."""
    senders = [(E2eSender(message.spec), bytes(message.spec.protected)) for message in MESSAGES]
    for number in count():
        for sender, data in senders:
            frame, key = sender.frame(data, now_ns=number), KEY if sender.spec.is_secured else None
            yield secured(frame, spec=sender.spec, key=key, freshness=Freshness(count=number))


def _datagrams(rng: Random, path: ReceivePath, sound: list[Frame]) -> list[Frame]:
    packed = [pack_message(to_message(frame)) for frame in sound]
    made_up = [any_datagram(rng, rng.choice(packed)) for _ in range(BATCH - GENUINE)]
    return path.datagrams(_mixed(rng, packed, made_up))


def _lines(rng: Random, path: ReceivePath, sound: list[Frame]) -> list[Frame]:
    genuine = [_line(frame) for frame in sound]
    made_up = [any_line(rng, rng.choice(genuine)) for _ in range(BATCH - GENUINE)]
    # A line without its end would take the next one with it: on a serial line that is so.
    return path.lines(b"".join(b"\r" + item if item in genuine else item for item in _mixed(rng, genuine, made_up)))


def _messages(rng: Random, path: ReceivePath, sound: list[Frame]) -> list[Frame]:
    made_up = [any_message(rng) for _ in range(BATCH - GENUINE)]
    return path.messages(_mixed(rng, [to_message(frame) for frame in sound], made_up))


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
    """Anything: noise, a sound one with damaged bytes, or one with damaged values."""
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
    """Anything, mostly with an end: noise, a damaged line, a line of another kind."""
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
    """A message of python-can's with any flags, and now and then a value of another type."""
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
