"""A sound store passes a sample of the cases of `python -m tests.proofs flash`, and each planted defect is found."""

import dataclasses
import json
from contextlib import suppress
from pathlib import Path

import pytest

from can_bridge.flashing.remembered import Remembered
from can_bridge.flashing.state import SlotPhase
from can_bridge.flashing.store import BootReason, Store
from contract.errors import StillwakeError
from tests.can_bridge.flashing.releases import booted, image, name_of, provision
from tests.proofs.flash import cuts
from tests.proofs.flash.cuts import Tally, walk
from tests.proofs.flash.places import FolderPlace

ROOT = Path(__file__).parents[3]

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def operations() -> int:
    return walk(0, lambda number: False).operations


def test_nothing_is_lost(operations):
    picked = range(7, operations, operations // 12)
    lines: list[str] = []
    tally = Tally(report=lines.append)
    walk(3, picked.__contains__, lambda first, second: first in picked[::4] and second == 30, tally)
    assert tally.cases[1] >= 12 and tally.cases[2] >= 1
    assert tally.findings == []
    # A second cut in the same place is the same case.
    name = next(line.partition(":")[0] for line in lines if line.partition(":")[0].count(".") == 2)
    again: list[str] = []
    (_, cut, _), same = cuts.case_of(name), Tally(report=again.append)
    walk(3, {cut}.__contains__, lambda first, second: second == 30, same)
    assert again and set(again) <= set(lines)


def test_planted_defects_are_found(monkeypatch, operations):
    """Those of the store's own defects that only a cut shows."""
    end, all_along = range(operations - 40, operations), range(0, operations, 5)
    activate, confirm, keep_slot = Store.activate, Store._confirm, Remembered.keep_slot

    def rising(self):
        activate(self)
        self.keep(dataclasses.replace(self.state, least_security_version=2))

    def uncounted(self, slot, changed):
        if not (changed.phase is SlotPhase.TRIAL and changed.boots_left < self.state.slots[slot].boots_left):
            keep_slot(self, slot, changed)

    def counter_first(self, slot):
        self.keep(dataclasses.replace(self.state, least_security_version=self.state.slots[slot].security_version))
        confirm(self, slot)

    def received_before_it_is_written(self, data):
        slot, standing = self._transfer()
        self.keep_slot(slot, dataclasses.replace(standing, received=standing.received + len(data)))
        self.backing.append(slot, data)

    def forgetful(self, slot, changed):
        if changed.phase is SlotPhase.FILLING and changed.received < changed.length:
            self.state = self.state.with_slot(slot, changed)
        else:
            keep_slot(self, slot, changed)

    def planted(picked: range, owner: type, name: str, value: object) -> set[str]:
        """What is found in these cases, up to the first one in which something is."""
        tally = Tally()
        # The sequence itself may not come to its end any more; the cases before count.
        with monkeypatch.context() as patch, suppress(StillwakeError):
            patch.setattr(owner, name, value)
            walk(0, lambda number: number in picked and not tally.findings, tally=tally)
        return {finding.kind for finding in tally.findings}

    # A file is renamed before it was synchronised, a checkpoint is kept before its slot was.
    sync = FolderPlace.sync
    assert planted(all_along, FolderPlace, "sync", lambda self, name: name.startswith("record") or sync(self, name))
    assert planted(all_along, FolderPlace, "sync", lambda self, name: name.startswith("slot") or sync(self, name))
    assert planted(range(operations), FolderPlace, "sync_folder", lambda self: None)
    assert planted(end, Store, "activate", rising) & {"counter_moved", "bricked", "confirmed_lost"}
    assert planted(end, Store, "_confirm", counter_first) & {"counter_moved", "bricked"}
    assert planted(all_along, Store, "append", received_before_it_is_written)
    assert "confirmed_lost" in planted(end, Remembered, "keep_slot", uncounted)
    assert "checkpoint_lost" in planted(all_along, Remembered, "keep_slot", forgetful)


def test_production_can_be_repeated_after_a_cut_in_any_operation():
    def again(_number: int, torn: FolderPlace) -> None:
        if booted(torn.backing())[1].reason is BootReason.NO_RELEASE:
            provision(torn.backing(), image())
        assert name_of(booted(torn.backing())[1]) == "one"

    place = FolderPlace()
    place.branch(lambda number: True, again)
    provision(place.backing(), image())
    assert place.operations > 20


def test_a_case_has_one_name():
    for case, name in (((0, 123), "0.123"), ((2, 7, 45), "2.7.45")):
        assert (cuts.name_of(case), cuts.case_of(name)) == (name, case)
    for name in ("", "1", "1.", "1.x", "1.2.3.4"):
        with pytest.raises(StillwakeError, match=r"must be such as 0\.123"):
            cuts.case_of(name)


def test_a_sample_of_the_whole_writes_the_figures(tmp_path):
    cuts.main(file := tmp_path / "flash.json", every=50, seeds=1, second_cuts=0.0, workers=1)
    figures = json.loads(file.read_text(encoding="utf-8"))["figures"]
    assert figures["cuts_depth_1"] == 6 and all(figures[kind] == 0 for kind in cuts.KINDS)
    written = json.loads((ROOT / "results" / "flash.json").read_text(encoding="utf-8"))["figures"]
    assert figures.keys() <= written.keys()
    assert figures["operations"] == written["operations"]
