"""The measurement finds a forgery that passes: checked on verifiers that were made weaker."""

from dataclasses import replace

import pytest

from benchmarks.bus import forgeries
from can_bridge.secoc import receiver
from can_bridge.wire.message_sets import CLASSIC, FD, SECURED


@pytest.fixture(autouse=True)
def _no_timing(monkeypatch):
    monkeypatch.setattr(forgeries, "cost", lambda: {})


def test_none_is_accepted_and_no_genuine_frame_is_refused():
    seen = []
    found = forgeries.measure(3000, progress=lambda done, total: seen.append((done, total)))
    assert found["authenticated_forgeries_accepted"] == 0
    counts = found["forgeries"]
    assert (counts["tried"], counts["genuine"], counts["genuine_refused"]) == (3000, 3000, 0)
    assert all(kind["tried"] > 200 for kind in counts["by_kind"].values())
    assert seen[-1] == (3000, 3000)


def accepted(found) -> set[str]:
    return {kind for kind, counts in found["forgeries"]["by_kind"].items() if counts["accepted"]}


@pytest.mark.parametrize("kind", ["mutated", "replayed, next freshness", "spliced", "guessed MAC", "another key"])
def test_without_the_mac_what_is_fresh_passes(monkeypatch, kind):
    def trusting(data, spec, key):
        return int.from_bytes(data[-16:-8], "big") if len(data) == spec.length else None

    monkeypatch.setattr(receiver, "verify", trusting)
    # One kind alone: a made-up freshness value that is accepted shuts out what comes later.
    monkeypatch.setattr(forgeries, "KINDS", {kind: forgeries.KINDS[kind]})
    assert accepted(forgeries.measure(90)) == {kind}


def test_without_the_freshness_replays_pass(monkeypatch):
    def forgetful(state, frames, *, spec, key):
        return receiver.verified(replace(state, freshness=0), frames, spec=spec, key=key)

    monkeypatch.setattr(forgeries, "verified", forgetful)
    assert accepted(forgeries.measure(900)) == {"replayed"}


def test_load_of_the_bus_is_that_of_the_bit_times():
    """Of classic CAN by hand: three frames of eight bytes, 135 bits each with most stuff bits (Davis et al., 2007)."""
    assert 0 < forgeries.bus_load_percent(FD) < forgeries.bus_load_percent(SECURED) < 5
    assert forgeries.bus_load_percent(CLASSIC) == pytest.approx(100 * 3 * 135 / 500e3 / 20e-3)
