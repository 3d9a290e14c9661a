from benchmarks.bus import fuzz


def test_small_fuzz_balances_and_is_the_same_for_the_same_seed():
    found = fuzz.measure(frames=1500, seed=3)
    assert found["fuzz_frames"] == found["accepted"] + sum(found["rejected"].values())
    assert (found["exceptions"], found["genuine"], found["genuine_lost"]) == (0, 150, 0)
    assert {"unreadable", "wrong length", "remote frame", "error frame", "29-bit identifier"} <= found[
        "rejected"
    ].keys()
    # A third of the genuine frames are secured. Their content under damaged flags may overtake them: then they are old.
    assert 40 <= found["authentic"] <= 50
    assert found["authentic_made_up"] == 0
    again = fuzz.measure(frames=1500, seed=3)
    for figures in (found, again):
        del figures["max_rss_growth_kib"]
    assert found == again
    assert fuzz.measure(frames=1500, seed=4)["rejected"] != found["rejected"]


def test_what_raises_is_told_with_its_batch(monkeypatch):
    def failing(rng: object, path: object, sound: object) -> None:
        raise RuntimeError("planted")

    monkeypatch.setattr(fuzz, "_lines", failing)
    found = fuzz.measure(frames=300)
    assert found["exceptions"] == 2
    assert found["failures"] == [f"batch {i} of seed 0: RuntimeError('planted')" for i in (1, 4)]
    assert found["genuine_lost"] == 10


def test_what_authenticates_though_nobody_sent_it_is_counted(monkeypatch):
    """A check that lets every secured frame pass: flipped bytes then count as authentic."""
    monkeypatch.setattr("benchmarks.bus.receive_path.verified", lambda state, frames, **_: (state, frames, False))
    found = fuzz.measure(frames=6000, seed=3)
    assert found["authentic_made_up"] > 0
    assert found["exceptions"] == 0
