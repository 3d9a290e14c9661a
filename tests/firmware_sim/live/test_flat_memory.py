"""An hour of clicks takes no more memory than a minute: everything that is kept is a ring."""

import gc

import numpy as np
import pytest

from contract.recording.episode import Episode
from contract.sensors import TRUCK
from firmware_sim.live import event_log
from tests.firmware_sim.bench.harness import NAMES
from tests.firmware_sim.live.harness import CONFIG, Live
from wake.plant.protocol import LoopPlant
from wake.recorded_wake import RecordedWake

KEPT = 40
ROUND = 100
"""Periods, two seconds, in which everything is set and taken back."""
BOUND = 6
"""Objects that three rounds may add: less than one for each thing that is clicked in them."""


def recording(name: str) -> LoopPlant:
    steps = np.arange(50)
    series = {
        "t": 0.2 * steps,
        "action": 0.0 * steps,
        "Cp": np.sin(0.3 * steps[:, None] + np.arange(len(TRUCK))),
        "Cd": 1.0 + 0.1 * np.sin(0.6 * steps),
        "Cl": np.sin(0.3 * steps),
    }
    episode = Episode(name="waves", role="test", series=series, initial_action=0.0, provenance={})
    return RecordedWake(episode, TRUCK, CONFIG.flow)


def clicks(live: Live) -> None:
    """Everything that a page has, within a round."""
    live.set(noise=0.5, dead=NAMES[0], loss=0.2).run(20)
    live.set(noise=0.2, delay_ms=50, babble=True, weights={"lift": 0.5}).run(15)
    live.ask(power_cycle=True)
    live.set(controller="off").run(5)
    live.set(controller="c", biased=NAMES[1]).run(10)
    live.ask(query="loss=2")
    live.ask(clear=True)
    live.run(ROUND - 50)
    # What the page has of it is the page's.
    for values in live.rows.values():
        values.clear()
    for kept in (live.events, live.pictures, live.made, live.controller.calls):
        kept.clear()


@pytest.mark.slow  # five rounds of everything that a page has
def test_rounds_of_clicks_leave_what_one_left(tmp_path, monkeypatch):
    """Counted in objects: tracing the memory itself takes a minute."""
    monkeypatch.setattr(event_log, "KEPT", 10)
    live = Live(tmp_path, wake=recording, kept=KEPT)
    counts = []
    for rounds in (2, 3):
        for _ in range(rounds):
            clicks(live)
        gc.collect()
        counts.append(len(gc.get_objects()))
    assert live.session.messages() == []
    assert counts[1] - counts[0] < BOUND, counts
