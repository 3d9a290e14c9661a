"""The soak adds up where nothing is wrong, and finds what was planted."""

import gc
import mmap
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from can_bridge.wire.frame import Frame
from can_bridge.wire.message_specs import PRESSURE
from contract.arrays import Array
from contract.controller.interface import ControlStep
from contract.recording.dataset import read
from contract.release import bundle
from contract.release.bundle import Bundle
from contract.shipped import recording
from firmware_sim.ecu.ecu import Ecu
from firmware_sim.ecu.ecu_state import EcuState
from tests.proofs.ecu import soak
from tests.proofs.ecu.replay import ReplayedPlant
from tests.proofs.ecu.witness import Passed

PERIODS = 1100
"""22 s, with a pause and a bus-off after 20 s in place of a minute."""


class Wanders:
    """Plans that move, without ONNX Runtime's milliseconds."""

    description = "a sine"

    def __init__(self) -> None:
        self._calls = 0

    def control_step(self, window: Array, plan: Array, free: Array, weights: Array | None = None) -> ControlStep:
        self._calls += 1
        new = 0.03 * np.sin(0.1 * (self._calls + np.arange(len(plan))))
        shifted = np.append(plan[1:], plan[-1])
        return ControlStep(
            plan=np.where(free > 0.5, new, shifted), forces=np.zeros((len(plan), 2)), terms=np.zeros(7), cost=0.0
        )


@pytest.fixture
def release(random_release: Path) -> Bundle:
    return bundle.load(random_release)


def soaked(release: Bundle, periods: int = PERIODS, **options: Any) -> soak.Soaked:
    config = soak.settings_of(release)
    # The test bundle is of the paper's operating point, which is the default; a few MB are the first use of everything.
    return soak.soak(release, Wanders(), config, periods=periods, seed=4, **{"most_growth_mb": 30.0, **options})


@pytest.mark.slow
def test_everything_adds_up_and_every_counter_moves(release: Bundle, monkeypatch: pytest.MonkeyPatch) -> None:
    """Through periods of the whole loop."""
    monkeypatch.setattr(soak, "_BUS_OFF_EVERY_NS", 20_000_000_000)
    monkeypatch.setattr(soak, "_STANDBY_EVERY", 1000)
    found = soaked(release)
    assert found.failures == ()
    assert found.figures["statuses_compared"] > 0.9 * PERIODS
    for name in ("crc_errors", "refused", "missed", "overruns"):
        assert found.figures[f"said_{name}"] == found.figures[f"counted_{name}"] > 0
    assert found.figures["said_bus_off"] > 0
    assert found.figures["periods_in_control"] > PERIODS // 2


@pytest.mark.proofs
def test_an_hour_adds_up(release: Bundle) -> None:
    """With plans that a sine makes; the command takes the shipped release."""
    assert soaked(release, 180_000, most_growth_mb=soak.MOST_GROWTH_MB).failures == ()


@pytest.mark.slow
def test_the_same_seed_gives_the_same_figures(release: Bundle) -> None:
    """Twice 250 periods, the faults drawn from the seed alone."""
    first, second = (
        {name: value for name, value in soaked(release, 250).figures.items() if not name.startswith(("rss", "took"))}
        for _ in range(2)
    )
    assert first == second


@pytest.mark.slow
def test_counters_that_forget_one_are_found(release: Bundle, monkeypatch: pytest.MonkeyPatch) -> None:
    """Through a thousand periods, each counter one too low."""
    honest, counters = EcuState.status, ("missed", "crc_errors", "refused", "overruns")

    def forgets(state: EcuState, bundle_hash: int) -> Any:
        status = honest(state, bundle_hash)
        return status._replace(**{name: max(0, getattr(status, name) - 1) for name in counters})

    monkeypatch.setattr(EcuState, "status", forgets)
    found = soaked(release, 1000)
    assert any("counters differ" in line for line in found.failures)
    for name in counters:
        assert found.figures[f"said_{name}"] == found.figures[f"counted_{name}"] - 1, name


@pytest.mark.slow
def test_a_frame_that_nobody_took_is_missed(release: Bundle, monkeypatch: pytest.MonkeyPatch) -> None:
    """Through 500 periods."""
    honest, taken = Passed.receive_all, False
    nearest: list[Passed] = []

    def loses(port: Passed) -> list[Frame]:
        nonlocal taken
        frames = honest(port)
        if any(map(PRESSURE.names, frames)) and not nearest:
            nearest.append(port)  # to the bus: it returns first, and the ECU's faults are behind it
        if taken or port not in nearest or port.received[PRESSURE.frame_id] < 100:
            return frames
        taken = True
        return [frame for frame in frames if not PRESSURE.names(frame)]

    monkeypatch.setattr(Passed, "receive_all", loses)
    found = soaked(release, 500)
    assert taken
    assert found.figures["frames_unaccounted"] == 1
    assert any("that no fault took" in line for line in found.failures), found.failures


@pytest.mark.slow
def test_memory_that_grows_is_found(release: Bundle, monkeypatch: pytest.MonkeyPatch) -> None:
    """400 periods that keep 1 MB each, in maps of their own: what earlier tests freed is not used for them, and what
    they left to be freed goes first.
    """
    kept: list[mmap.mmap] = []
    honest = Ecu.step

    def hoards(ecu: Ecu, *arguments: Any) -> list[Frame]:
        pages = mmap.mmap(-1, 1_000_000)
        pages.write(b"\x01" * 1_000_000)
        kept.append(pages)
        return honest(ecu, *arguments)

    monkeypatch.setattr(Ecu, "step", hoards)
    gc.collect()
    found = soaked(release, 400, most_growth_mb=20.0)
    assert any("memory grew by" in line for line in found.failures)


@pytest.fixture(scope="module")
def replayed() -> Iterator[ReplayedPlant]:
    (episode,) = (one for one in read(recording()).episodes if one.name == "controlled_1_0")
    short = replace(episode, series={name: values[:4] for name, values in episode.series.items()})
    yield ReplayedPlant(short, 0.2)


def test_the_recording_is_replayed_to_and_fro(replayed: ReplayedPlant) -> None:
    seen = []
    for k in range(13):
        seen.append(replayed.sample())
        replayed.advance_to(10)
        replayed.advance_to(30, 0.01 * k)
    rows = [float(sample.Cd) for sample in seen]
    assert rows[:7] == [*rows[:4], rows[2], rows[1], rows[0]]
    assert rows[6:13] == rows[:7]
    assert [sample.action for sample in seen] == [0.0, *(0.01 * k for k in range(12))]
    assert [sample.t for sample in seen] == pytest.approx(0.2 * np.arange(13))
