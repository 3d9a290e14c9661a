"""Damaged and made-up receptions through the whole receive path, with genuine frames between them."""

import resource
from collections.abc import Callable, Iterator
from itertools import count
from random import Random
from typing import Any, Final

from can.interfaces.udp_multicast.utils import pack_message

from can_bridge.bus.conversion import to_message
from can_bridge.e2e.sender import E2eSender
from can_bridge.secoc.freshness import Freshness
from can_bridge.secoc.node import secured
from can_bridge.wire.frame import Frame
from tests.proofs.bus.garbage import any_datagram, any_line, any_message
from tests.proofs.bus.receive_path import KEY, MESSAGES, ReceivePath

BATCH: Final = 50
"""Receptions between two collections, a tenth of them genuine."""
GENUINE: Final = 5
WARM_UP: Final = 0.1
"""Share of the frames before memory is looked at for the first time: until then it fills what it keeps."""


def measure(
    *, frames: int = 300_000, seed: int = 0, progress: Callable[[int, int], None] = lambda done, total: None
) -> dict[str, Any]:
    """Feed datagrams, serial lines and drivers' messages in turn.

    Args:
        frames: receptions of the three kinds together, a tenth of them genuine and the others made up.
        seed: of all of them.
        progress: called with receptions done and in all.

    Returns:
        `fuzz_frames`, receptions as the buses counted them (noise on a serial line may hold several); `accepted` frames
        and `rejected` by reason; `genuine` frames sent between them and `genuine_lost`; `exceptions`, each of which is
        also in `failures` with its kind; `authentic` secured frames, among which `authentic_made_up` were sent by
        no one; `max_rss_growth_kib` after the first tenth.
    """
    rng = Random(seed)
    path = ReceivePath()
    genuine = _genuine_frames()
    sent = lost = done = authentic = made_up = 0
    failures: list[str] = []
    rss_before: int | None = None
    for batch in range(-(-frames // BATCH)):
        sound = [next(genuine) for _ in range(GENUINE)]
        try:
            got = (_datagrams, _lines, _messages)[batch % 3](rng, path, sound)
        except Exception as error:  # noqa: BLE001 - what this looks for
            failures.append(f"batch {batch} of seed {seed}: {error!r}")
            got = []
        arrived = [(frame.frame_id, frame.data, frame.is_fd) for frame in got]
        for frame in sound:
            sent += 1
            try:
                arrived.remove((frame.frame_id, frame.data, frame.is_fd))
            except ValueError:
                lost += 1
        authentic += len(path.authentic)
        # What is made up is made from this batch's frames: no other authentic content can be in it.
        made_up += len({frame.data for frame in path.authentic} - {frame.data for frame in sound})
        path.authentic.clear()
        done = min(frames, done + BATCH)
        progress(done, frames)
        if rss_before is None and done >= WARM_UP * frames:
            rss_before = _max_rss_kib()
    accepted, rejected = path.totals()
    return {
        "fuzz_frames": sum(bus.received for bus in path.buses),
        "accepted": accepted,
        "rejected": {reason.value: count for reason, count in rejected.items() if count},
        "genuine": sent,
        "genuine_lost": lost,
        "authentic": authentic,
        "authentic_made_up": made_up,
        "exceptions": len(failures),
        "failures": failures[:10],
        "max_rss_growth_kib": _max_rss_kib() - (rss_before or 0),
    }


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
    places = set(rng.sample(range(len(genuine) + len(made_up)), len(genuine)))
    first, second = iter(genuine), iter(made_up)
    return [next(first) if place in places else next(second) for place in range(len(genuine) + len(made_up))]


def _line(frame: Frame) -> bytes:
    code = f"{(*range(9), 12, 16, 20, 24, 32, 48, 64).index(len(frame.data)):X}"
    return f"{'b' if frame.is_fd else 't'}{frame.frame_id:03X}{code}{frame.data.hex().upper()}\r".encode()


def _max_rss_kib() -> int:
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
