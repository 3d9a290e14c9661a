"""The report's layout and values; `tests/proofs/loader_in_c` compares the report of every state with that of C."""

import json

from can_bridge.flashing import report
from can_bridge.flashing.backing import Slot
from can_bridge.flashing.state import Level, SlotPhase, SlotState, StoreState
from contract.errors import BusError
from contract.printable import MAX_NAME
from tests.can_bridge.flashing.plain_backing import PlainBacking
from tests.can_bridge.flashing.releases import booted, damage, image, keys, provisioned, store_on, updated
from tests.refused import refused

GREATEST = 2**32 - 1
LONGEST_SLOT = SlotState(
    phase=SlotPhase.CONFIRMED, name="\U0001f69a" * MAX_NAME, digest="f" * 64, security_version=GREATEST,
    received=GREATEST, length=GREATEST, boots_left=3,
)  # fmt: skip
LONGEST = StoreState(
    slots=(LONGEST_SLOT, LONGEST_SLOT), active=Slot.A, least_security_version=GREATEST,
    failed_attempts=dict.fromkeys(Level, 255),
)  # fmt: skip


def test_it_has_what_the_store_holds():
    store = store_on(PlainBacking())
    store.state = LONGEST
    raw = report.encode(store)
    found = report.decode(raw)
    assert (found.slots[1].name, found.slots[0].received, len(raw) < 2048) == (LONGEST_SLOT.name, GREATEST, True)
    assert (found.running, found.reason, found.failed_attempts) == (None, None, LONGEST.failed_attempts)
    backing = updated(image("two", version=4))
    damage(backing, Slot.B)
    store, _ = booted(backing)
    store.take_keys(keys(7))
    store.keep_failed_attempts(Level.CALIBRATION, 2)
    body = json.loads(json.dumps(report.tree(report.decode(report.encode(store)))))
    assert body["reason"] == "NO_RELEASE"
    assert (body["running"], body["active"], body["next_boot"]) == (None, "B", "B")
    assert (body["least_security_version"], body["key_list_version"]) == (4, 7)
    assert body["failed_attempts"] == {"PROGRAMMING": 0, "CALIBRATION": 2}
    slots = [(slot["name"], slot["phase"], slot["verdict"]) for slot in body["slots"]]
    assert slots == [("one", "CONFIRMED", "TOO_OLD"), ("two", "CONFIRMED", "WRONG_HASH")]


def test_what_is_no_report_is_refused_in_one_line():
    whole = report.encode(booted(provisioned())[0])
    wrong = {0: 0x54, 4: 2, 5: 2, 6: 9, 7: 6, 18: 6, 19: 16, 22: 4, 67: 0x1B, 68: 0xFF}
    for raw in (
        *(whole[:at] + bytes([value]) + whole[at + 1 :] for at, value in wrong.items()),
        *(whole[:length] for length in range(len(whole))),
        whole + b"\0",
    ):
        with refused(BusError, "the ECU's report of its store is damaged") as caught:
            report.decode(raw)
        assert str(caught.value).isprintable(), raw
