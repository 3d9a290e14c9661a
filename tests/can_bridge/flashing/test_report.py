import json

import pytest
from hypothesis import given
from hypothesis import strategies as st

from can_bridge.flashing import report
from can_bridge.flashing.access_level import Level
from can_bridge.flashing.backing import Slot
from can_bridge.flashing.boot import BootReason
from can_bridge.flashing.report import MAX_REPORT, Report, SlotReport, report_of
from can_bridge.flashing.state import Phase
from can_bridge.flashing.verdicts import Verdict
from contract.errors import BusError
from contract.printable import MAX_NAME, is_name
from tests.can_bridge.flashing.releases import (
    BLOCK,
    SECOND,
    booted,
    damage,
    digest_of,
    flash,
    image,
    keys,
    provisioned,
    store_on,
    transfer,
    updated,
)
from tests.examples import examples

U32 = st.integers(0, 2**32 - 1)
MAYBE = {"running": Slot, "active": Slot, "next_boot": Slot, "reason": BootReason}
SLOTS = st.builds(
    SlotReport,
    phase=st.sampled_from(Phase),
    name=st.just("") | st.text(min_size=1, max_size=100).filter(is_name),
    digest=st.just("") | st.binary(min_size=32, max_size=32).map(bytes.hex),
    security_version=U32,
    received=U32,
    length=U32,
    boots_left=st.integers(0, 3),
    verdict=st.sampled_from([None, *Verdict]),
)
REPORTS = st.builds(
    Report,
    slots=st.tuples(SLOTS, SLOTS),
    **{name: st.sampled_from([None, *kind]) for name, kind in MAYBE.items()},
    least_security_version=U32,
    key_list_version=st.none() | U32,
    failed_attempts=st.fixed_dictionaries(dict.fromkeys(Level, U32)),
)


@examples(100)
@given(REPORTS)
def test_what_goes_in_comes_out(value):
    raw = report.encode(value)
    assert report.decode(raw) == value
    assert len(raw) < MAX_REPORT


def test_the_longest_one_is_short_enough():
    longest = SlotReport(
        phase=Phase.CONFIRMED, name="\U0001f69a" * MAX_NAME, digest="f" * 64, security_version=2**32 - 1,
        received=2**32 - 1, length=2**32 - 1, boots_left=3, verdict=Verdict.WRONG_HARDWARE,
    )  # fmt: skip
    greatest = 2**32 - 1
    longest_report = Report(
        slots=(longest, longest), running=Slot.A, active=Slot.A, next_boot=Slot.A, reason=BootReason.NO_RELEASE,
        least_security_version=greatest, key_list_version=greatest, failed_attempts=dict.fromkeys(Level, 255),
    )  # fmt: skip
    assert len(report.encode(longest_report)) < MAX_REPORT


def test_it_has_what_the_store_holds():
    backing = updated(image("two", version=4))
    damage(backing, Slot.B)
    store, _ = booted(backing)
    store.take_keys(keys(7))
    store.records.keep_failed_attempts(Level.CALIBRATION, 2)
    body = json.loads(report.encode(report_of(store)))
    assert body["reason"] == "NO_RELEASE"
    assert (body["running"], body["active"], body["next_boot"]) == (None, "B", "B")
    assert (body["least_security_version"], body["key_list_version"]) == (4, 7)
    assert body["failed_attempts"] == {"PROGRAMMING": 0, "CALIBRATION": 2}
    assert [slot["name"] for slot in body["slots"]] == ["one", "two"]
    assert [slot["phase"] for slot in body["slots"]] == ["CONFIRMED", "CONFIRMED"]
    assert [slot["verdict"] for slot in body["slots"]] == ["TOO_OLD", "WRONG_HASH"]


def test_it_follows_a_transfer_and_a_trial():
    backing = provisioned()
    assert report_of(store_on(backing)).reason is None
    store, boot = booted(backing)
    assert report_of(store).running_slot == SlotReport(
        phase=Phase.CONFIRMED, name="one", digest=digest_of(boot), security_version=1, received=len(image()),
        length=len(image()), boots_left=0, verdict=Verdict.GOOD,
    )  # fmt: skip
    transfer(store, image("two"), until=BLOCK)
    filling = report_of(store).slots[Slot.B]
    assert (filling.phase, filling.received, filling.length) == (Phase.FILLING, BLOCK, len(image("two")))
    assert (filling.name, filling.digest, filling.verdict) == ("", "", None)
    flash(store, image("two"))
    assert (report_of(store).next_boot, report_of(store).running) == (Slot.B, Slot.A)
    store, _ = booted(backing)
    trial = report_of(store).running_slot
    assert trial is not None
    assert (trial.phase, trial.boots_left, trial.name) == (Phase.TRIAL, 2, "two")
    flash(store, image("three", key=SECOND))
    assert report_of(store).running_slot is None


GOOD = json.loads(report.encode(report_of(booted(provisioned())[0])))


def with_slot(**changes: object) -> dict[str, object]:
    return GOOD | {"slots": [GOOD["slots"][0] | changes, GOOD["slots"][1]]}


def test_what_is_no_report_is_refused_in_one_line():
    for body in (
        GOOD | {"schema": "stillwake-store/2"},
        GOOD | {"more": 1},
        {name: value for name, value in GOOD.items() if name != "active"},
        GOOD | {"slots": GOOD["slots"][:1]},
        GOOD | {"slots": GOOD["slots"] * 2},
        GOOD | {"slots": None},
        GOOD | {"slots": [1, 2]},
        GOOD | {"running": "C"},
        GOOD | {"running": 0},
        GOOD | {"reason": "BECAUSE"},
        GOOD | {"least_security_version": -1},
        GOOD | {"least_security_version": True},
        GOOD | {"least_security_version": 1.0},
        GOOD | {"key_list_version": 2**32},
        GOOD | {"failed_attempts": {"PROGRAMMING": 0}},
        GOOD | {"failed_attempts": {"PROGRAMMING": 0, "CALIBRATION": "0"}},
        GOOD | {"failed_attempts": []},
        with_slot(phase=None),
        with_slot(phase="DONE"),
        with_slot(name="a\x1b[2J"),
        with_slot(name=1),
        with_slot(digest="ab"),
        with_slot(digest=None),
        with_slot(length=None),
        with_slot(verdict="FINE"),
        with_slot(more=1),
    ):
        with pytest.raises(BusError, match="the ECU's report of its store is damaged") as refused:
            report.decode(json.dumps(body).encode())
        assert str(refused.value).isprintable(), body


def test_what_is_no_table_is_refused():
    raw = json.dumps(GOOD).encode()
    cuts = [raw[:length] for length in range(len(raw))]
    for damaged in (b"", b"[]", b"\xff", b'{"slots": NaN}', b"[" * 2000, b" " * 2049, *cuts):
        with pytest.raises(BusError, match="damaged"):
            report.decode(damaged)
