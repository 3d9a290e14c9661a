"""Stretches of traffic through both ECUs; the same seed, variant and length give the same periods everywhere."""

from collections import Counter
from collections.abc import Iterator
from dataclasses import replace
from itertools import islice
from random import Random
from typing import Any, Final, NamedTuple

import numpy as np

from tests.proofs.ecu_in_c.edges import Edges
from tests.proofs.ecu_in_c.library import Layout, Library
from tests.proofs.ecu_in_c.python_twin import Answers, Period, PythonTwin
from tests.proofs.ecu_in_c.traffic import EDGES, Traffic
from tests.proofs.ecu_in_c.variants import VARIANTS

MOVED_SEEDS: Final = tuple("13579")
MOVED: Final = 0.3  # periods that start from a state near an edge, in stretches with an odd seed
NEARLY_ALL: Final = 0.8  # the same in recordings, which are to be sharp and short
CHUNK: Final = 1_000  # periods that are recorded before C lives through them


class Stretch(NamedTuple):
    steps: int
    mismatch: str | None  # at which it ended: variant, seed, period, and fields that differ with both values
    modes: Counter[str]  # periods in each operating mode


def recorded(
    twin: PythonTwin, periods: Iterator[Period], count: int, edges: Edges | None, rng: Random, moved: float = MOVED
) -> tuple[Any, Counter[str]]:
    """So many periods of the Python ECU, moved by `edges` now and then, as an array of `twin_period`, and its modes."""
    room, modes = twin.layout.ffi.new("twin_period[]", count), Counter[str]()
    for place, period in zip(room, islice(periods, count), strict=True):
        if edges is not None and rng.random() < moved:
            state = twin.power_on if period.restarts else twin.ecu.state
            frames = period.frames if rng.random() < 0.5 else []
            answers = period.answers if moved < NEARLY_ALL or rng.random() < 0.7 else spoilt(period.answers, rng)
            near = replace(period, loads=edges.near(state, period.now_ns), frames=frames, answers=answers)
            twin.live_through(near, place)
        else:
            twin.live_through(period, place)
        modes[twin.ecu.state.fail_safe.mode.name] += 1
    return room, modes


def _begun_anew(periods: Iterator[Period]) -> Iterator[Period]:
    """In front of them, an ECU that is switched on at each time where something could change, and steps once more."""
    for now_ns in EDGES:
        for restarts in (True, False):
            yield replace(next(periods), now_ns=now_ns, restarts=restarts, frames=[])
    yield from periods


def spoilt(answers: Answers, rng: Random) -> Answers:
    """With a number in plan or forecast that is none, or no answer at all."""
    if rng.random() < 0.2:
        return replace(answers, is_planned=False)
    plan, forces = answers.plan.copy(), answers.forces.copy()
    place = rng.choice((plan, forces[:, 0], forces[:, 1]))
    place[rng.randrange(len(place))] = rng.choice((np.nan, np.inf, -np.inf))
    return replace(answers, plan=plan, forces=forces)


def stretch(library: Library, name: str, seed: str, steps: int) -> Stretch:
    """Live through one on both sides, until they differ."""
    layout, modes, done = library.layout, Counter[str](), 0
    twin, periods, edges, rng = _begun(name, seed, layout)
    while done < steps:
        count = min(CHUNK, steps - done)
        room, some = recorded(twin, periods, count, edges, rng)
        modes += some
        same = library.run(room, count)
        if same < count:
            shown = "; ".join(layout.differences(room[same].response, library.found[0])[:3])
            return Stretch(done + same, f"{name!r}, seed {seed!r}, period {done + same}: {shown}", modes)
        done += count
    return Stretch(done, None, modes)


def recording(name: str, seed: str, steps: int, layout: Layout) -> bytes:
    """Periods as bytes, for other programs; with an odd seed, nearly all of them are near an edge."""
    twin, periods, edges, rng = _begun(name, seed, layout)
    room, _ = recorded(twin, _begun_anew(periods), steps, edges, rng, NEARLY_ALL)
    return bytes(layout.ffi.buffer(room))


def _begun(name: str, seed: str, layout: Layout) -> tuple[PythonTwin, Iterator[Period], Edges | None, Random]:
    twin, rng = PythonTwin(VARIANTS[name], layout), Random(f"edges {seed}")
    edges = Edges(VARIANTS[name], rng) if seed.endswith(MOVED_SEEDS) else None
    return twin, Traffic(VARIANTS[name], twin.horizon, f"{name} {seed}"), edges, rng
