"""The proof finds what is wrong: a sound store passes a sample of its cases, and each planted defect is found."""

import dataclasses
import json
from contextlib import suppress

import pytest

from benchmarks.flash import cuts, proof, releases, tables
from benchmarks.flash.case import Case
from benchmarks.flash.cuts import Tally, both_bad, walk
from can_bridge.flashing.flash_memory.flash_backing import FlashBacking
from can_bridge.flashing.remembered import Remembered
from can_bridge.flashing.state import Phase
from can_bridge.flashing.store import Store
from can_bridge.uds.programming import Programming
from contract.errors import StillwakeError


@pytest.fixture(scope="module")
def operations() -> dict[str, int]:
    """Of the whole sequence."""
    return {kind: walk(kind, 0, lambda number: False).operations for kind in cuts.PLACES}


@pytest.mark.parametrize(("kind", "cases"), [("flash", 12), ("folder", 12)])
def test_nothing_is_lost(kind, cases, operations):
    step = operations[kind] // cases
    found = walk(kind, 3, lambda n: n % step == 7, lambda first, second: first % 5 == 0 and second == 30)
    assert found.cases[1] >= cases
    assert found.cases[2] >= 1
    assert found.findings == []


@pytest.mark.parametrize("kind", cuts.PLACES)
def test_an_ecu_without_a_release_can_be_flashed(kind):
    assert both_bad(kind, 0).findings == []


def kinds_found(kind: str, picked: range) -> set[str]:
    """What is found in these cases, up to the first one in which something is."""
    tally = Tally()
    # The sequence itself may not come to its end any more; the cases before count.
    with suppress(StillwakeError):
        walk(kind, 0, lambda number: number in picked and not tally.findings, tally=tally)
    return {finding.kind for finding in tally.findings}


def end(operations: dict[str, int]) -> range:
    """Activation, boot on trial and confirmation."""
    return range(operations["flash"] - 60, operations["flash"], 4)


def test_activation_that_confirms_is_found(monkeypatch, operations):
    def activate(self):
        slot = self.state.checked
        confirmed = dataclasses.replace(self.state.slots[slot], phase=Phase.CONFIRMED)
        self._remembered.keep(self.state.with_slot(slot, confirmed, active=slot))

    monkeypatch.setattr(Store, "activate", activate)
    monkeypatch.setattr(Programming, "_confirm", lambda self: None)
    assert kinds_found("flash", end(operations)) & {"confirmed_lost", "counter_moved"}


def test_a_security_version_that_rises_with_activation_is_found(monkeypatch, operations):
    activate = Store.activate

    def rising(self):
        activate(self)
        self._remembered.keep(dataclasses.replace(self.state, least_security_version=2))

    monkeypatch.setattr(Store, "activate", rising)
    assert kinds_found("flash", end(operations)) & {"counter_moved", "bricked", "confirmed_lost"}


def test_a_trial_that_is_not_counted_is_found(monkeypatch, operations):
    keep_slot = Remembered.keep_slot

    def uncounted(self, slot, changed):
        if not (changed.phase is Phase.TRIAL and changed.boots_left < self.state.slots[slot].boots_left):
            keep_slot(self, slot, changed)

    monkeypatch.setattr(Remembered, "keep_slot", uncounted)
    assert "confirmed_lost" in kinds_found("flash", end(operations))


def test_a_transfer_without_checkpoints_is_found(monkeypatch, operations):
    keep_slot = Remembered.keep_slot

    def forgetful(self, slot, changed):
        if changed.phase is Phase.FILLING and changed.received < changed.length:
            self.state = self.state.with_slot(slot, changed)
        else:
            keep_slot(self, slot, changed)

    monkeypatch.setattr(Remembered, "keep_slot", forgetful)
    assert "checkpoint_lost" in kinds_found("flash", range(1500, 1560, 20))


def test_a_checkpoint_before_its_bytes_is_found(monkeypatch, operations):
    monkeypatch.setattr(FlashBacking, "_tails_changed", lambda self: False)
    assert kinds_found("flash", range(1500, 3000, 100))


def test_writing_over_the_confirmed_image_is_found(monkeypatch):
    writable = Store._writable_slot
    monkeypatch.setattr(Store, "_writable_slot", lambda self: writable(self).other)
    assert kinds_found("flash", range(60, 400, 40)) & {"bricked", "confirmed_lost"}


@pytest.mark.parametrize(
    "case",
    [Case("flash", 0, 123), Case("flash", 2, 7, 45), Case("folder", 0, 0), Case("folder", 11, None)],
)
def test_a_case_has_one_name(case):
    assert Case.parse(str(case)) == case


def test_names_are_short_and_checked():
    assert str(Case("flash", 0, 123, 45)) == "flash-0123+0045"
    assert str(Case("folder", 2, None)) == "folder.2-both-bad"
    for name in ("", "flash", "flash-", "flash-1+", "disk-0001", "flash-0001+0002+0003", "flash-both-bad+0001"):
        with pytest.raises(StillwakeError, match="must be such as flash-0123"):
            Case.parse(name)


def test_a_second_cut_in_the_same_place_is_the_same_case():
    told: list[list[str]] = []
    for _ in range(2):
        lines: list[str] = []
        walk("flash", 1, lambda n: n == 2000, lambda first, second: second == 25, Tally(tell=lines.append))
        told.append(lines)
    assert told[0] == told[1]
    assert any(line.startswith("flash.1-2000+0025: ") for line in told[0])


@pytest.mark.processes
def test_a_sample_of_the_whole_measurement_fills_the_tables(tmp_path, monkeypatch):
    monkeypatch.setattr(proof, "LOSSES", (0.0,))
    proof.main(tmp_path / "flash.json", every=700, folder_seeds=1, second_cuts=0.0, fuzz_requests=200, workers=1)
    figures = json.loads((tmp_path / "flash.json").read_text(encoding="utf-8"))["figures"]
    assert (figures["cuts_depth_1"], figures["both_slots_spoilt"]) == (5, 2)
    assert all(figures[kind] == 0 for kind in cuts.KINDS)
    assert figures["fuzz_requests"] == 200
    assert 1.0 < figures["seconds_flash"] < 3.0
    made = tables.tables(tmp_path)
    assert "one in 700 of them" in made["flash_proof"]
    assert f"{len(releases.image(2))} bytes" in made["flash_times"]
