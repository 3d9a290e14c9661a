"""Frames of someone without the key, sent between genuine ones; and what authentication costs.

The attacker knows everything but the key: the DBC, every frame sent so far, and the freshness value that comes next.
"""

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial
from time import perf_counter
from typing import Any, Final

import numpy as np

from can_bridge.e2e.profiles import profile_of
from can_bridge.e2e.sender import SenderState, protected_frame
from can_bridge.secoc.freshness import Freshness
from can_bridge.secoc.key import KEY_LENGTH, Key
from can_bridge.secoc.receiver import VerifierState, verified
from can_bridge.secoc.securing import secure, verify
from can_bridge.wire.bit_timing import worst_case_ns
from can_bridge.wire.frame import FD_LENGTHS, Frame
from can_bridge.wire.message_sets import CLASSIC, FD, SECURED, MessageSet
from can_bridge.wire.message_specs import FRESHNESS_LENGTH, MAC_LENGTH, MessageSpec
from contract.config.tree import Config

CHUNK: Final = 1000
"""Forgeries between two reports of progress."""
RECORDED: Final = 1000
"""Genuine frames of the other messages that the attacker has."""
REPEATS: Final = 7
"""Timings, of which the fastest counts."""

Progress = Callable[[int, int], None]


@dataclass(kw_only=True, eq=False)
class _Scene:
    """A bus after some genuine frames.

    Attributes:
        spec: the message that is attacked.
        key, other: the nodes', and the attacker's own.
        number: of the next genuine frame.
        sent: genuine frames by their message's name; the attacker has recorded them.
    """

    spec: MessageSpec
    key: Key
    other: Key
    rng: np.random.Generator
    number: int = 0
    sent: dict[str, list[Frame]] = field(default_factory=dict)

    def genuine(self, spec: MessageSpec) -> Frame:
        """The next one of a message, from its sender."""
        frame = secure(self.plain(spec, self.number), spec, self.key, Freshness(count=self.number))
        self.sent.setdefault(spec.name, []).append(frame)
        return frame

    def plain(self, spec: MessageSpec, number: int) -> Frame:
        """With a right E2E header, and not secured."""
        counter = SenderState(counter=number % profile_of(spec).counter_period)
        return protected_frame(counter, self.rng.bytes(spec.protected), spec=spec, now_ns=0)

    def recorded(self, name: str) -> bytes:
        """The data of any genuine frame so far."""
        frames = self.sent[name]
        return frames[self.rng.integers(len(frames))].data


def _random(scene: _Scene) -> bytes:
    return scene.rng.bytes(scene.spec.length)


def _mutated(scene: _Scene) -> bytes:
    """One to eight bits of the frame that the genuine sender is about to send, which the attacker delays."""
    data = secure(scene.plain(scene.spec, scene.number), scene.spec, scene.key, Freshness(count=scene.number)).data
    word = int.from_bytes(data, "big")
    for bit in scene.rng.choice(8 * len(data), size=int(scene.rng.integers(1, 9)), replace=False).tolist():
        word ^= 1 << bit
    return word.to_bytes(len(data), "big")


def _replayed(scene: _Scene) -> bytes:
    return scene.recorded(scene.spec.name)


def _replayed_with_the_next_freshness(scene: _Scene) -> bytes:
    data = scene.recorded(scene.spec.name)
    return data[: -FRESHNESS_LENGTH - MAC_LENGTH] + _next_freshness(scene) + data[-MAC_LENGTH:]


def _reflected(scene: _Scene) -> bytes:
    """The other node's, or this one's other message, cut or filled up to the length."""
    names = [item for item in scene.sent if item != scene.spec.name]
    data = scene.recorded(names[scene.rng.integers(len(names))])
    length = scene.spec.length
    return (data[-length:] if scene.rng.random() < 0.5 else data[:length]).rjust(length, b"\0")


def _spliced(scene: _Scene) -> bytes:
    """New content with right E2E header, next freshness, and the MAC of any genuine frame of any message."""
    names = list(scene.sent)
    return _head(scene) + scene.recorded(names[scene.rng.integers(len(names))])[-MAC_LENGTH:]


def _guessed(scene: _Scene) -> bytes:
    """The same with a random MAC."""
    return _head(scene) + scene.rng.bytes(MAC_LENGTH)


def _under_another_key(scene: _Scene) -> bytes:
    ahead = int(scene.rng.integers(1 << 20))
    frame = scene.plain(scene.spec, scene.number)
    return secure(frame, scene.spec, scene.other, Freshness(count=scene.number + ahead)).data


def _of_another_length(scene: _Scene) -> bytes:
    length = int(scene.rng.choice([item for item in FD_LENGTHS if item != scene.spec.length]))
    return scene.recorded(scene.spec.name)[:length].ljust(length, b"\0")


def _head(scene: _Scene) -> bytes:
    data = scene.plain(scene.spec, scene.number).data
    return data.ljust(scene.spec.length - FRESHNESS_LENGTH - MAC_LENGTH, b"\0") + _next_freshness(scene)


def _next_freshness(scene: _Scene) -> bytes:
    return Freshness(count=scene.number).value.to_bytes(FRESHNESS_LENGTH, "big")


KINDS: Final[dict[str, Callable[[_Scene], bytes]]] = {
    "random": _random,
    "mutated": _mutated,
    "replayed": _replayed,
    "replayed, next freshness": _replayed_with_the_next_freshness,
    "reflected": _reflected,
    "spliced": _spliced,
    "guessed MAC": _guessed,
    "another key": _under_another_key,
    "another length": _of_another_length,
}


def measure(count: int = 300_000, *, seed: int = 0, progress: Progress = lambda done, total: None) -> dict[str, Any]:
    """Attack each secured message with a third of `count` forgeries, a genuine frame behind each.

    Returns:
        `authenticated_forgeries_accepted`; `forgeries` with the counts behind it, by kind too, and how many genuine
        frames were refused; `authentication_cost`, see `cost`.
    """
    accepted, tried = dict.fromkeys(KINDS, 0), dict.fromkeys(KINDS, 0)
    kinds = list(KINDS)
    genuine = refused = done = 0
    for spec in SECURED.specs:
        rng = np.random.default_rng([seed, spec.frame_id])
        scene = _Scene(spec=spec, key=Key(rng.bytes(KEY_LENGTH)), other=Key(rng.bytes(KEY_LENGTH)), rng=rng)
        for item in SECURED.specs:
            # What the attacker has recorded of the other messages; numbers of their own.
            for number in range(RECORDED if item is not spec else 0):
                scene.number = number
                scene.genuine(item)
        state, scene.number = VerifierState(), 0
        for _ in range(count // 3):
            state, passed, _none = verified(state, [scene.genuine(spec)], spec=spec, key=scene.key)
            genuine, refused, scene.number = genuine + 1, refused + (not passed), scene.number + 1
            kind = kinds[rng.integers(len(kinds))]
            forgery = Frame(frame_id=spec.frame_id, data=KINDS[kind](scene))
            state, passed, _none = verified(state, [forgery], spec=spec, key=scene.key)
            tried[kind] += 1
            accepted[kind] += len(passed)
            done += 1
            if done % CHUNK == 0:
                progress(done, count)
    progress(count, count)
    return {
        "authenticated_forgeries_accepted": sum(accepted.values()),
        "forgeries": {
            "tried": sum(tried.values()),
            "by_kind": {kind: {"tried": tried[kind], "accepted": accepted[kind]} for kind in KINDS},
            "genuine": genuine,
            "genuine_refused": refused,
        },
        "authentication_cost": cost(),
    }


def cost(frames: int = 5000) -> dict[str, Any]:
    """What authentication costs: time for a frame at either end next to E2E, on this machine; bytes; load of the bus.

    `secure_us` comes on top of `e2e_protect_us`, `verify_us` on top of `e2e_check_us`.

    Args:
        frames: of each message, in each of several timings.
    """
    key, messages = Key(bytes(range(1, 1 + KEY_LENGTH))), {}
    for plain, spec in zip(FD.specs, SECURED.specs, strict=True):
        content = bytes(spec.protected)
        frame = protected_frame(SenderState(), content, spec=spec, now_ns=0)
        whole = secure(frame, spec, key, Freshness())
        check = profile_of(spec).check
        messages[plain.name] = {
            "e2e_protect_us": _microseconds(
                partial(protected_frame, SenderState(), content, spec=spec, now_ns=0), frames
            ),
            "secure_us": _microseconds(partial(secure, frame, spec, key, Freshness()), frames),
            "e2e_check_us": _microseconds(partial(check, frame.data, data_id=spec.data_id), frames),
            "verify_us": _microseconds(partial(verify, whole.data, spec, key), frames),
            "bytes": plain.length,
            "bytes_authenticated": spec.length,
        }
    return {
        "messages": messages,
        "bus_load_percent": {messages.name: bus_load_percent(messages) for messages in (FD, SECURED, CLASSIC)},
    }


def bus_load_percent(messages: MessageSet) -> float:
    """Load of a set's three messages in each control period, at the default bit rates and with the most stuff bits."""
    config = Config()
    rates = {"nominal_bitrate": config.bus.nominal_bitrate, "data_bitrate": config.bus.data_bitrate}
    busy = sum(
        worst_case_ns(Frame(frame_id=spec.frame_id, data=bytes(spec.length), is_fd=spec.is_fd), **rates)
        for spec in messages.specs
    )
    return 100 * busy / config.period_ns


def _microseconds(call: Callable[[], object], count: int) -> float:
    """Time of one call: the fastest of several timings, since whatever else the machine does adds to them."""
    times = []
    for _ in range(REPEATS):
        began = perf_counter()
        for _ in range(count):
            call()
        times.append(perf_counter() - began)
    return 1e6 * min(times) / count
