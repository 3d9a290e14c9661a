"""The measurement finds what a protection lets pass: checked on protections that were made weaker."""

from dataclasses import replace
from math import comb

import pytest

from benchmarks.bus import flips
from can_bridge.e2e import profiles
from can_bridge.wire.message_specs import SPECS

SMALL = flips.Plan(three_bit=200, random=300, among_genuine=20)


@pytest.fixture(autouse=True)
def _three_messages(monkeypatch):
    """One of each set, the shortest: the others' errors of two bits take seconds."""
    monkeypatch.setattr(flips, "SPECS", [spec for spec in SPECS if spec.name.startswith("JetCommand")])


def test_every_flip_is_tried_and_the_same_seed_finds_the_same():
    seen = []
    found = flips.measure(SMALL, seed=3, processes=1, progress=lambda done, total: seen.append((done, total)))
    assert found["flips_accepted"] == 0
    for name, length in (("JetCommand", 8), ("JetCommandClassic", 8), ("JetCommandSecured", 24)):
        message = found["flips"][name]
        assert message["one_bit"] == {"tried": 8 * length, "accepted": 0}
        assert message["two_bit"] == {"tried": comb(8 * length, 2), "accepted": 0}
        assert message["three_bit"] == {"tried": 200, "exhaustive": False, "accepted": 0}
        assert message["random"]["live"] == 0
        assert message["random"]["tried"] == 300
        # A genuine stream with every fifth frame replaced is trusted from its second frame on.
        assert message["random_among_genuine"] == {"tried": 20, "live": 0, "genuine_live": 79}
    assert seen[-1][0] == seen[-1][1] == sum(SMALL.frames(spec) for spec in SPECS if spec.name.startswith("JetCommand"))
    assert found == flips.measure(SMALL, seed=3, processes=1)
    # The only message of these that profile 5 judges.
    assert found["random_accepted_per_million"] == found["flips"]["JetCommand"]["random_per_million"]


def test_few_enough_errors_of_three_bits_are_all_tried():
    plan = flips.Plan(three_bit=50_000, random=0, among_genuine=0)
    found = flips.measure(plan, processes=1)["flips"]
    assert found["JetCommandClassic"]["three_bit"] == {"tried": 41_664, "exhaustive": True, "accepted": 0}
    assert found["JetCommandSecured"]["three_bit"] == {"tried": 50_000, "exhaustive": False, "accepted": 0}


def test_random_bytes_pass_eight_bits_of_crc_as_often_as_they_should(monkeypatch):
    """Five standard deviations of a binomial distribution around 2^-8."""
    monkeypatch.setattr(flips, "SPECS", [spec for spec in SPECS if spec.name == "JetCommandClassic"])
    plan = flips.Plan(three_bit=0, random=20_000, among_genuine=0)
    found = flips.measure(plan, processes=1)["flips"]["JetCommandClassic"]
    expected = 20_000 / 256
    assert found["expected_random_per_million"] == 3906.25
    assert abs(found["random"]["accepted"] - expected) < 5 * expected**0.5
    assert found["random_per_million"] == 50 * found["random"]["accepted"]


def test_a_weaker_code_is_found_out(monkeypatch):
    """Of profile 2's CRC the lowest bit alone: half of the single flips pass, at least."""
    real = profiles.PROFILES[2]

    def weak(data: bytes, *, data_id: int) -> bool:
        sound = real.protect(data, data_id=data_id, counter=real.counter_of(data))
        return (sound[0] ^ data[0]) & 1 == 0

    weakened = replace(real, check=weak)
    monkeypatch.setattr(profiles, "PROFILES", {**profiles.PROFILES, 2: weakened})
    found = flips.measure(SMALL, processes=1)
    assert found["flips"]["JetCommandClassic"]["one_bit"]["accepted"] > 20
    assert found["flips"]["JetCommandClassic"]["random"]["live"] > 0
    assert found["flips"]["JetCommand"]["one_bit"]["accepted"] == 0
    assert found["flips_accepted"] >= found["flips"]["JetCommandClassic"]["one_bit"]["accepted"]


@pytest.mark.processes  # two interpreters start
def test_processes_make_no_difference(monkeypatch):
    plan, seen = flips.Plan(three_bit=20, random=30, among_genuine=2), []
    alone = flips.measure(plan, seed=5, processes=1)
    together = flips.measure(plan, seed=5, processes=2, progress=lambda done, total: seen.append((done, total)))
    assert together == alone
    assert list(together["flips"]) == list(alone["flips"])
    assert seen[-1][0] == seen[-1][1]
