"""What is done to the bus on purpose: short runs, and the faults planted in a protection that each part must find."""

from dataclasses import replace
from math import comb

import pytest

from can_bridge.e2e import profiles
from can_bridge.secoc import receiver
from can_bridge.timing.periodic_message import PeriodicMessage
from can_bridge.timing.response_time import response_times
from can_bridge.wire.frame import Frame
from can_bridge.wire.frame_bits import frame_ns
from can_bridge.wire.message_sets import CLASSIC, FD, SECURED
from can_bridge.wire.message_specs import SPECS
from contract.config.vehicle import BusConfig
from tests.proofs.bus import flips, forgeries, fuzz, response_time

SMALL = flips.Plan(three_bit=200, random=5000, among_genuine=20)
BUS = BusConfig()


@pytest.fixture(autouse=True)
def _small(monkeypatch, request):
    """Only the shortest messages, whose errors of two bits take no seconds; no timing."""
    if request.node.get_closest_marker("proofs") is None:
        monkeypatch.setattr(flips, "SPECS", [spec for spec in SPECS if spec.name.startswith("JetCommand")])
        monkeypatch.setattr(forgeries, "cost", lambda: {})
        monkeypatch.setattr(forgeries, "RECORDED", 50)


@pytest.mark.proofs
def test_at_length():
    assert flips.measure()["flips_accepted"] == 0
    assert forgeries.measure()["authenticated_forgeries_accepted"] == 0
    fuzzed = fuzz.measure()
    assert (fuzzed["exceptions"], fuzzed["genuine_lost"], fuzzed["authentic_made_up"]) == (0, 0, 0)
    assert response_time.measure()["response_time_violations"] == 0


def test_every_flip_is_tried_and_none_is_accepted():
    measured = flips.measure(SMALL, seed=3, processes=1)
    assert measured["flips_accepted"] == 0
    for name, length in (("JetCommand", 8), ("JetCommandClassic", 8), ("JetCommandSecured", 24)):
        message = measured["flips"][name]
        assert message["one_bit"] == {"tried": 8 * length, "accepted": 0}, name
        assert message["two_bit"] == {"tried": comb(8 * length, 2), "accepted": 0}, name
        assert message["three_bit"] == {"tried": 200, "exhaustive": False, "accepted": 0}, name
        # A genuine stream with every fifth frame replaced is trusted from its second frame on.
        assert message["random_among_genuine"] == {"tried": 20, "live": 0, "genuine_live": 79}, name
        assert message["random"]["live"] == 0, name
    # Eight bits of CRC let pass one of 256, within five standard deviations of the binomial distribution.
    assert abs(measured["flips"]["JetCommandClassic"]["random"]["accepted"] - 5000 / 256) < 5 * (5000 / 256) ** 0.5


def test_a_weaker_code_is_found(monkeypatch):
    """With the lowest bit of profile 2's CRC alone, half of the single flips pass, at least."""
    real = profiles.PROFILES[2]

    def weak(data: bytes, *, data_id: int) -> bool:
        sound = real.protect(data, data_id=data_id, counter=real.counter_of(data))
        return (sound[0] ^ data[0]) & 1 == 0

    monkeypatch.setattr(profiles, "PROFILES", {**profiles.PROFILES, 2: replace(real, check=weak)})
    measured = flips.measure(SMALL._replace(random=300), processes=1)
    classic = measured["flips"]["JetCommandClassic"]
    assert classic["one_bit"]["accepted"] > 20 and classic["random"]["live"] > 0
    assert measured["flips"]["JetCommand"]["one_bit"]["accepted"] == 0
    assert measured["flips_accepted"] >= classic["one_bit"]["accepted"]


def test_no_forgery_is_accepted_and_no_genuine_frame_refused():
    measured = forgeries.measure(3000)
    counts = measured["forgeries"]
    assert measured["authenticated_forgeries_accepted"] == 0
    assert (counts["tried"], counts["genuine"], counts["genuine_refused"]) == (3000, 3000, 0)
    assert all(kind["tried"] > 200 for kind in counts["by_kind"].values())


def test_without_mac_or_freshness_what_they_keep_out_passes(monkeypatch):
    every, verified = forgeries.KINDS, receiver.verified

    def trusting(data, spec, key):
        return int.from_bytes(data[-16:-8], "big") if len(data) == spec.length else None

    def forgetful(state, frames, *, spec, key):
        return verified(replace(state, freshness=0), frames, spec=spec, key=key)

    for owner, name, defect, kinds in (
        (
            receiver,
            "verify",
            trusting,
            ("mutated", "replayed, next freshness", "spliced", "guessed MAC", "another key"),
        ),
        (forgeries, "verified", forgetful, ("replayed",)),
    ):
        with monkeypatch.context() as patch:
            patch.setattr(owner, name, defect)
            for kind in kinds:
                # One kind alone: a made-up freshness value that is accepted shuts out what comes later.
                patch.setattr(forgeries, "KINDS", {kind: every[kind]})
                assert forgeries.measure(90)["authenticated_forgeries_accepted"] > 0, kind


def test_load_of_the_bus_is_that_of_the_bit_times():
    """Classic CAN by hand: three frames of eight bytes, 135 bits each with most stuff bits (Davis et al., 2007)."""
    assert 0 < forgeries.bus_load_percent(FD) < forgeries.bus_load_percent(SECURED) < 5
    assert forgeries.bus_load_percent(CLASSIC) == pytest.approx(100 * 3 * 135 / 500e3 / 20e-3)


def test_of_anything_on_the_wire_all_is_counted_and_genuine_frames_arrive(monkeypatch):
    measured = fuzz.measure(frames=1500, seed=3)
    assert measured["fuzz_frames"] == measured["accepted"] + sum(measured["rejected"].values())
    assert (measured["exceptions"], measured["genuine"], measured["genuine_lost"]) == (0, 150, 0)
    reasons = {"unreadable", "wrong length", "remote frame", "error frame", "29-bit identifier"}
    assert reasons <= measured["rejected"].keys()
    # A third of the genuine frames are secured. Their content under damaged flags may overtake them: then they are old.
    assert 40 <= measured["authentic"] <= 50 and measured["authentic_made_up"] == 0
    with monkeypatch.context() as patch:
        patch.setattr("tests.proofs.bus.receive_path.verified", lambda state, frames, **_: (state, frames, False))
        assert fuzz.measure(frames=6000, seed=3)["authentic_made_up"] > 0
    monkeypatch.setattr(fuzz, "_lines", lambda rng, path, sound: 1 // 0)
    measured = fuzz.measure(frames=300)
    assert [line.split(":")[0] for line in measured["failures"]] == [f"batch {i} of seed 0" for i in (1, 4)]
    assert (measured["exceptions"], measured["genuine_lost"]) == (2, 10)


def length_ns(frame: Frame) -> int:
    return frame_ns(frame, nominal_bitrate=BUS.nominal_bitrate, data_bitrate=BUS.data_bitrate)


def test_the_published_counterexample_happens_on_the_bus():
    """A, B and C of Davis et al. (2007), their periods in frames: 2.5, 3.5 and 3.5, all frames equally long.

    C's second frame takes 3.5 frames, where the analysis of 1994 promised 3 and the deadline is at 3.25.
    """
    every = [Frame(frame_id=frame_id, data=bytes(7), is_fd=False) for frame_id in range(1, 0x7FF)]
    frames = [frame for frame in every if length_ns(frame) == length_ns(every[0])][:3]
    unit = length_ns(frames[0])
    messages = [
        PeriodicMessage(
            name=name, frame_id=frame.frame_id, is_fd=False, length=7, period_ns=unit * halves // 2,
            deadline_ns=unit * quarters // 4,
        )
        for name, frame, halves, quarters in zip("ABC", frames, (5, 7, 7), (10, 13, 13), strict=True)
    ]  # fmt: skip
    bound, played = response_time.at_critical_instant(messages, frames, 2, BUS)
    assert played.longest_ns[2] == bound.response_ns == 3.5 * unit
    assert (bound.instance, bound.in_time) == (1, False)


def test_no_message_is_later_than_its_bound():
    measured = response_time.measure(sets=6)
    assert measured["response_time_violations"] == 0
    assert 0 < measured["largest_ratio"] <= 1 and 0 < measured["largest_ratio_with_true_lengths"] <= 1


def without_jitter_of_others(timings, *, bit_ns):
    still = [replace(one, jitter_ns=0) for one in timings]
    return [
        response_times([*still[:level], own, *still[level + 1 :]], bit_ns=bit_ns)[level]
        for level, own in enumerate(timings)
    ]


def without_blocking(timings, *, bit_ns):
    return [response_times(timings[: level + 1], bit_ns=bit_ns)[level] for level in range(len(timings))]


def test_an_analysis_that_leaves_something_out_is_refuted(monkeypatch):
    for wrong in (without_jitter_of_others, without_blocking):
        monkeypatch.setattr(response_time, "response_times", wrong)
        assert response_time.measure(sets=3)["response_time_violations"] > 0, wrong
