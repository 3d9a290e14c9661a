"""What is done to the bus on purpose: short runs, and the faults planted in a protection that each part must find."""

from dataclasses import replace

from can_bridge.secoc import securing
from tests.proofs.bus import forgeries, fuzz

HELD_OFF_BY_THE_MAC = ("mutated", "replayed, next freshness", "spliced", "guessed MAC", "another key")


def test_no_forgery_is_accepted_and_no_genuine_frame_refused():
    measured = forgeries.measure(3000, recorded=50)
    counts = measured["forgeries"]
    assert measured["authenticated_forgeries_accepted"] == 0
    assert (counts["tried"], counts["genuine"], counts["genuine_refused"]) == (3000, 3000, 0)
    assert all(kind["tried"] > 200 for kind in counts["by_kind"].values())


def test_without_mac_or_freshness_what_they_keep_out_passes(monkeypatch):
    every, verified = forgeries.KINDS, securing.verified

    def trusting(data, spec, key):
        return int.from_bytes(data[-16:-8], "big") if len(data) == spec.length else None

    def forgetful(state, frames, *, spec, key):
        return verified(replace(state, freshness=0), frames, spec=spec, key=key)

    for owner, name, defect, kinds in (
        (securing, "verify", trusting, HELD_OFF_BY_THE_MAC),
        (forgeries, "verified", forgetful, ("replayed",)),
    ):
        with monkeypatch.context() as patch:
            patch.setattr(owner, name, defect)
            for kind in kinds:
                # One kind alone: a made-up freshness value that is accepted shuts out what comes later.
                patch.setattr(forgeries, "KINDS", {kind: every[kind]})
                assert forgeries.measure(90, recorded=50)["authenticated_forgeries_accepted"] > 0, kind


def test_of_anything_on_the_wire_all_is_counted_and_genuine_frames_arrive(monkeypatch):
    measured = fuzz.measure(frames=1500, seed=3)
    assert measured["fuzz_frames"] == measured["accepted"] + sum(measured["rejected"].values())
    assert (measured["exceptions"], measured["genuine"], measured["genuine_lost"]) == (0, 150, 0)
    reasons = {"unreadable", "wrong length", "remote frame", "error frame", "29-bit identifier"}
    assert reasons <= measured["rejected"].keys()
    # A third of the genuine frames are secured. Their content under damaged flags may overtake them: then they are old.
    assert 40 <= measured["authentic"] <= 50 and measured["authentic_made_up"] == 0
    with monkeypatch.context() as patch:
        patch.setattr(fuzz, "verified", lambda state, frames, **_: (state, frames, False))
        assert fuzz.measure(frames=6000, seed=3)["authentic_made_up"] > 0
    monkeypatch.setattr(fuzz.ReceivePath, "lines", lambda path, rng, sound: 1 // 0)
    measured = fuzz.measure(frames=300)
    assert [line.split(":")[0] for line in measured["failures"]] == [f"batch {i} of seed 0" for i in (1, 4)]
    assert (measured["exceptions"], measured["genuine_lost"]) == (2, 10)
