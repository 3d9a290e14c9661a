"""Frames of someone without the key, sent between genuine ones.

The attacker knows everything but the key: the DBC, every frame sent so far, and the freshness value that comes next.
"""

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, Final

import numpy as np

from benchmarks.common.command_line import track
from can_bridge.e2e.profiles import SenderState, profile_of, protected_frame
from can_bridge.secoc.key import KEY_LENGTH, Key
from can_bridge.secoc.securing import Freshness, VerifierState, secure, verified
from can_bridge.wire.frame import FD_LENGTHS, Frame
from can_bridge.wire.message_sets import SECURED
from can_bridge.wire.message_specs import FRESHNESS_LENGTH, MAC_LENGTH, MessageSpec


@dataclass(kw_only=True, eq=False)
class _Scene:
    """A bus after genuine frames, which the attacker, who has `other`, recorded; the next one has the `number`."""

    spec: MessageSpec
    key: Key
    other: Key
    rng: np.random.Generator
    number: int = 0
    sent: dict[str, list[Frame]] = field(default_factory=dict)

    def genuine(self, spec: MessageSpec) -> Frame:
        frame = secure(self.plain(spec), spec, self.key, Freshness(count=self.number))
        self.sent.setdefault(spec.name, []).append(frame)
        return frame

    def plain(self, spec: MessageSpec) -> Frame:
        """A frame with a right E2E header, and not secured."""
        counter = SenderState(counter=self.number % profile_of(spec).counter_period)
        return protected_frame(counter, self.rng.bytes(spec.protected), spec=spec, now_ns=0)

    def recorded(self, *names: str) -> bytes:
        """The data of any genuine frame so far, of these messages."""
        frames = self.sent[names[self.rng.integers(len(names))]]
        return frames[self.rng.integers(len(frames))].data

    @property
    def next_freshness(self) -> bytes:
        return Freshness(count=self.number).value.to_bytes(FRESHNESS_LENGTH, "big")


def _mutated(scene: _Scene) -> bytes:
    """One to eight bits of the frame that the genuine sender is about to send, which the attacker delays."""
    data = secure(scene.plain(scene.spec), scene.spec, scene.key, Freshness(count=scene.number)).data
    word = int.from_bytes(data, "big")
    for bit in scene.rng.choice(8 * len(data), size=int(scene.rng.integers(1, 9)), replace=False).tolist():
        word ^= 1 << bit
    return word.to_bytes(len(data), "big")


def _replayed_with_the_next_freshness(scene: _Scene) -> bytes:
    data = scene.recorded(scene.spec.name)
    return data[: -FRESHNESS_LENGTH - MAC_LENGTH] + scene.next_freshness + data[-MAC_LENGTH:]


def _reflected(scene: _Scene) -> bytes:
    """The other node's, or this one's other message, cut or filled up to the length."""
    data, length = scene.recorded(*(name for name in scene.sent if name != scene.spec.name)), scene.spec.length
    return (data[-length:] if scene.rng.random() < 0.5 else data[:length]).rjust(length, b"\0")


def _under_another_key(scene: _Scene) -> bytes:
    ahead = int(scene.rng.integers(1 << 20))
    return secure(scene.plain(scene.spec), scene.spec, scene.other, Freshness(count=scene.number + ahead)).data


def _of_another_length(scene: _Scene) -> bytes:
    length = int(scene.rng.choice([item for item in FD_LENGTHS if item != scene.spec.length]))
    return scene.recorded(scene.spec.name)[:length].ljust(length, b"\0")


def _head(scene: _Scene) -> bytes:
    """New content with right E2E header and the next freshness, to which a MAC is missing."""
    length = scene.spec.length - FRESHNESS_LENGTH - MAC_LENGTH
    return scene.plain(scene.spec).data.ljust(length, b"\0") + scene.next_freshness


KINDS: Final[dict[str, Callable[[_Scene], bytes]]] = {
    "random": lambda scene: scene.rng.bytes(scene.spec.length),
    "mutated": _mutated,
    "replayed": lambda scene: scene.recorded(scene.spec.name),
    "replayed, next freshness": _replayed_with_the_next_freshness,
    "reflected": _reflected,
    "spliced": lambda scene: _head(scene) + scene.recorded(*scene.sent)[-MAC_LENGTH:],
    "guessed MAC": lambda scene: _head(scene) + scene.rng.bytes(MAC_LENGTH),
    "another key": _under_another_key,
    "another length": _of_another_length,
}


def measure(count: int = 300_000, *, recorded: int = 1000, seed: int = 0) -> dict[str, Any]:
    """Attack each secured message with its share of `count` forgeries, a genuine frame behind each. The attacker has
    `recorded` frames of each other message. The figures have counts by kind, and how many genuine ones were refused."""
    by_kind = {kind: {"tried": 0, "accepted": 0} for kind in KINDS}
    kinds, refused = list(KINDS), 0
    for spec in SECURED.specs:
        rng = np.random.default_rng([seed, spec.frame_id])
        scene = _Scene(spec=spec, key=Key(rng.bytes(KEY_LENGTH)), other=Key(rng.bytes(KEY_LENGTH)), rng=rng)
        # What the attacker has recorded of the other messages has numbers of its own.
        for item in SECURED.specs:
            for scene.number in range(recorded if item is not spec else 0):
                scene.genuine(item)
        state, scene.number = VerifierState(), 0
        for _ in track(range(count // len(SECURED.specs)), "forgeries", "frames"):
            state, passed, _none = verified(state, [scene.genuine(spec)], spec=spec, key=scene.key)
            refused, scene.number = refused + (not passed), scene.number + 1
            kind = kinds[rng.integers(len(kinds))]
            forgery = Frame(frame_id=spec.frame_id, data=KINDS[kind](scene))
            state, passed, _none = verified(state, [forgery], spec=spec, key=scene.key)
            by_kind[kind]["tried"] += 1
            by_kind[kind]["accepted"] += len(passed)
    tried = sum(row["tried"] for row in by_kind.values())
    return {
        "authenticated_forgeries_accepted": sum(row["accepted"] for row in by_kind.values()),
        "forgeries": {"tried": tried, "by_kind": by_kind, "genuine": tried, "genuine_refused": refused},
    }
