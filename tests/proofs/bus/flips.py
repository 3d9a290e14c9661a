"""What damage each message's protection lets pass: flipped bits, and random bytes in place of a frame.

Everything runs through the functions that the nodes use. For a secured message the judge is the MAC; E2E comes behind
it.
"""

from collections.abc import Callable, Iterable, Iterator
from functools import partial
from itertools import combinations
from math import comb
from os import sched_getaffinity
from typing import Any, Final, NamedTuple

import numpy as np

from can_bridge.e2e.profiles import profile_of
from can_bridge.e2e.receiver import E2eReceiver
from can_bridge.e2e.sender import SenderState, protected_frame
from can_bridge.secoc.freshness import Freshness
from can_bridge.secoc.key import KEY_LENGTH, Key
from can_bridge.secoc.node import secured
from can_bridge.secoc.receiver import VerifierState, verified
from can_bridge.secoc.securing import verify
from can_bridge.wire.frame import Frame
from can_bridge.wire.message_specs import SPECS, MessageSpec
from contract.config.vehicle import E2eConfig
from tests.proofs.command_line import spread, track

CHUNK: Final = 10_000
"""Frames drawn at a time."""
PROFILE_5_BITS: Final = 16
"""Bits of its CRC."""
EVERY: Final = 5
"""In a genuine stream, one frame of so many is replaced by random bytes: the default window bears that."""


class Plan(NamedTuple):
    """How many frames of each message.

    Attributes:
        three_bit: sampled errors of three bits; all of them where there are no more.
        random: random payloads, for the check of one frame and for the state machine.
        among_genuine: random payloads that each replace a frame of a genuine stream.
    """

    three_bit: int = 1_000_000
    random: int = 1_000_000
    among_genuine: int = 100_000


def measure(plan: Plan | None = None, *, seed: int = 0, processes: int | None = None) -> dict[str, Any]:
    """Damage every message of the three sets, each by a sequence of its own from the seed.

    Args:
        processes: as many as there are processors without it; the figures do not depend on it.

    Returns:
        `flips_accepted`, of all messages and all flips; `random_accepted_per_million` by profile 5, whose length alone
        gives 15.3; and in `flips`, by message, the counts behind them and the rate that the length of its code gives.
    """
    # The slow ones first, so that no process is left with one of them.
    order = sorted(SPECS, key=lambda spec: not spec.is_secured)
    work = partial(_measure, plan=plan or Plan(), seed=seed)
    counts = track(spread(work, order, processes or len(sched_getaffinity(0))), "flips", "messages", len(order))
    measured = {spec.name: row for spec, row in zip(order, list(counts), strict=True)}
    by_profile_5 = [measured[spec.name]["random"] for spec in SPECS if _code_bits(spec) == PROFILE_5_BITS]
    accepted, tried = (sum(row[key] for row in by_profile_5) for key in ("accepted", "tried"))
    return {
        "flips_accepted": sum(
            row[f"{count}_bit"]["accepted"] for row in measured.values() for count in ("one", "two", "three")
        ),
        "random_accepted_per_million": _per_million(accepted, tried),
        "flips": {spec.name: measured[spec.name] for spec in SPECS},
    }


def _measure(spec: MessageSpec, plan: Plan, seed: int) -> dict[str, Any]:
    rng = np.random.default_rng([seed, spec.frame_id])
    key = Key(rng.bytes(KEY_LENGTH)) if spec.is_secured else None
    passes = _check_of(spec, key)
    # Any content will do: the codes are linear, and a MAC knows no better or worse ones.
    sound = _genuine(spec, key, 0, rng.bytes(spec.protected)).data
    if not passes(sound):
        raise ValueError(f"{spec.name}: the frame to be damaged is not sound")

    def accepted(choices: Iterable[tuple[int, ...]]) -> int:
        return sum(map(passes, _flipped(sound, choices)))

    bits = range(8 * spec.length)
    every = comb(len(bits), 3) <= plan.three_bit
    three = comb(len(bits), 3) if every else plan.three_bit
    triples = combinations(bits, 3) if every else _triples(rng, len(bits), three)
    live = sum(map(_live_alone(spec, key), _random(rng, spec, plan.random)))
    taken = sum(map(passes, _random(rng, spec, plan.random)))
    return {
        "bytes": spec.length,
        "one_bit": {"tried": len(bits), "accepted": accepted(combinations(bits, 1))},
        "two_bit": {"tried": comb(len(bits), 2), "accepted": accepted(combinations(bits, 2))},
        "three_bit": {"tried": three, "exhaustive": every, "accepted": accepted(triples)},
        "random": {"tried": plan.random, "accepted": taken, "live": live},
        "random_among_genuine": _among_genuine(spec, key, plan.among_genuine, rng),
        "random_per_million": _per_million(taken, plan.random),
        "expected_random_per_million": 1e6 * 2.0 ** -_code_bits(spec),
    }


def _per_million(count: int, of: int) -> float:
    return 1e6 * count / max(of, 1)


def _code_bits(spec: MessageSpec) -> int:
    return 64 if spec.is_secured else {2: 8, 5: PROFILE_5_BITS}[spec.profile]


def _check_of(spec: MessageSpec, key: Key | None) -> Callable[[bytes], bool]:
    """Whether one frame's data passes, by itself."""
    if key is not None:
        return lambda data: verify(data, spec, key) is not None
    return partial(profile_of(spec).check, data_id=spec.data_id)


def _genuine(spec: MessageSpec, key: Key | None, number: int, content: bytes) -> Frame:
    counter = SenderState(counter=number % profile_of(spec).counter_period)
    frame = protected_frame(counter, content, spec=spec, now_ns=0)
    return secured(frame, spec=spec, key=key, freshness=Freshness(count=number))


def _flipped(sound: bytes, choices: Iterable[tuple[int, ...]]) -> Iterator[bytes]:
    word, masks = int.from_bytes(sound, "big"), [1 << bit for bit in range(8 * len(sound))]
    for choice in choices:
        damaged = word
        for bit in choice:
            damaged ^= masks[bit]
        yield damaged.to_bytes(len(sound), "big")


def _triples(rng: np.random.Generator, bits: int, count: int) -> Iterator[tuple[int, ...]]:
    """Three different bits each, uniformly."""
    while count > 0:
        drawn = [triple for triple in rng.integers(bits, size=(min(count, CHUNK), 3)).tolist() if len(set(triple)) == 3]
        count -= len(drawn)
        yield from map(tuple, drawn)


def _random(rng: np.random.Generator, spec: MessageSpec, count: int) -> Iterator[bytes]:
    for start in range(0, count, CHUNK):
        block = rng.bytes(spec.length * min(CHUNK, count - start))
        for at in range(0, len(block), spec.length):
            yield block[at : at + spec.length]


def _live_alone(spec: MessageSpec, key: Key | None) -> Callable[[bytes], bool]:
    """Whether a payload is taken as live by a receiver that hears nothing else; it remembers."""
    receiver, state = E2eReceiver(spec, E2eConfig()), VerifierState()

    def is_live(data: bytes) -> bool:
        nonlocal state
        frame = Frame(frame_id=spec.frame_id, data=data, is_fd=spec.is_fd)
        state, frames, _ = verified(state, [frame], spec=spec, key=key)
        return receiver.tick(frames).live is not None

    return is_live


def _among_genuine(spec: MessageSpec, key: Key | None, tried: int, rng: np.random.Generator) -> dict[str, int]:
    """A genuine stream with random payloads in place of every fifth frame: how many of either are taken as live."""
    is_live, content = _live_alone(spec, key), bytes(spec.protected)
    genuine, live, number = 0, 0, 0
    for payload in _random(rng, spec, tried):
        for _ in range(EVERY - 1):
            genuine += is_live(_genuine(spec, key, number, content).data)
            number += 1
        live, number = live + is_live(payload), number + 1
    return {"tried": tried, "live": live, "genuine_live": genuine}
