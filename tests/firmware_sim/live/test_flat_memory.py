"""An hour of clicks takes no more memory than a minute: everything that is kept is a ring."""

import gc

import pytest

from firmware_sim.live import event_log
from tests.firmware_sim.bench.harness import NAMES, LiveOscillator
from tests.firmware_sim.live.harness import CONFIG, Live
from wake.plant.sample import Sample

KEPT = 40
ROUND = 100
"""Periods, two seconds, in which everything is set and taken back."""
BOUND = 6
"""Objects that three rounds may add: less than one for each thing that is clicked in them."""


class Forgetful(LiveOscillator):
    def sample(self) -> Sample:
        self.seen.clear()
        return super().sample()


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
    live = Live(tmp_path, wake=lambda name: Forgetful(CONFIG), kept=KEPT)
    counts = []
    for rounds in (2, 3):
        for _ in range(rounds):
            clicks(live)
        gc.collect()
        counts.append(len(gc.get_objects()))
    assert live.session.messages() == []
    assert counts[1] - counts[0] < BOUND, counts
