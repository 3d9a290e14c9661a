"""The store's place in a folder: nothing that was kept is lost with the supply."""

import os
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from can_bridge.flashing.backing import Kind, Slot
from can_bridge.flashing.folder_backing import FolderBacking
from can_bridge.flashing.medium import MediumError
from tests.can_bridge.flashing.lossy_files import LossyFiles
from tests.can_bridge.flashing.sessions import Witness, run
from tests.examples import examples

PLAN = [(Slot.A, 1), (Slot.B, 2), (Slot.A, 3)]
LENGTHS = {1: 900, 2: 1301, 3: 620}


def play(files: LossyFiles, cuts: list[int]) -> None:
    """The plan with cuts, each so many calls after the one before; then to its end."""
    witness = Witness(LENGTHS)

    def power_on() -> FolderBacking:
        return FolderBacking(Path("unused"), files=files, capacity=2048)

    for cut in cuts:
        files.power_on(files.operations + cut)
        if run(power_on, witness, PLAN):
            return
    files.power_on()
    assert run(power_on, witness, PLAN)


def every_cut(seeds: int) -> None:
    files = LossyFiles()
    play(files, [])
    for cut in range(files.operations):
        for seed in range(seeds):
            play(LossyFiles(seed), [cut])


@pytest.mark.slow
def test_every_cut_leaves_the_old_or_the_new():
    every_cut(2)


@pytest.mark.slow
@examples(100)
@given(st.integers(0, 2**32), st.lists(st.integers(0, 200), max_size=12))
def test_many_cuts_in_a_row(seed, cuts):
    play(LossyFiles(seed), cuts)


def test_planted_defects_are_found(monkeypatch):
    sync = LossyFiles.sync
    for name, defect in (
        ("sync_folder", lambda self: None),
        # Renamed before it was synchronised; a checkpoint before the slot was.
        ("sync", lambda self, name: None if name.startswith("record") else sync(self, name)),
        ("sync", lambda self, name: None if name.startswith("slot") else sync(self, name)),
    ):
        with monkeypatch.context() as patch, pytest.raises(Exception):  # noqa: B017  (whatever shows it)
            patch.setattr(LossyFiles, name, defect)
            every_cut(4)


def test_it_outlives_the_process(tmp_path):
    backing = FolderBacking(tmp_path / "ecu")
    for _ in backing.clear(Slot.B):
        pass
    backing.append(Slot.B, b"first ")
    backing.keep(Kind.STATE, b"state")
    backing.append(Slot.B, b"lost")
    again = FolderBacking(tmp_path / "ecu")
    assert again.records() == {Kind.STATE: b"state"}
    again.begin_again(Slot.B, 6)
    again.append(Slot.B, b"second")
    assert again.read(Slot.B, 0, 12) == b"first second"
    with pytest.raises(MediumError, match="nothing was written at byte 12"):
        again.read(Slot.B, 3, 10)
    assert {path.name for path in (tmp_path / "ecu").iterdir()} == {"state.record", "slot_b.image"}
    assert {path.stat().st_mode & 0o777 for path in (tmp_path / "ecu").iterdir()} == {0o600}
    for damage in (b"", b"SWR1", b"x" * 40):
        (tmp_path / "ecu" / "state.record").write_bytes(damage)
        assert again.records() == {}, damage


def test_what_the_system_refuses_is_one_line(tmp_path):
    (tmp_path / "file").write_bytes(b"")
    with pytest.raises(MediumError, match=r"store .*file: File exists"):
        FolderBacking(tmp_path / "file")
    backing = FolderBacking(tmp_path / "folder", capacity=10)
    with pytest.raises(MediumError, match="clear it"):
        backing.append(Slot.A, b"x")
    for _ in backing.clear(Slot.A):
        pass
    with pytest.raises(MediumError, match="holds 10 bytes"):
        backing.append(Slot.A, bytes(11))
    with pytest.raises(MediumError, match="0 bytes are there, must be 5 or more"):
        backing.begin_again(Slot.A, 5)
    # A FIFO has to be refused, not waited for.
    for name in ("state.record", "slot_b.image"):
        os.mkfifo(tmp_path / "folder" / name)
    for use in (backing.records, lambda: backing.read(Slot.B, 0, 1), lambda: next(iter(backing.clear(Slot.B)))):
        with pytest.raises(MediumError, match=r"store .*: (must be a regular file|No such device)"):
            use()
    (tmp_path / "folder" / "record.new").mkdir()
    with pytest.raises(MediumError, match=r"record\.new"):
        backing.keep(Kind.STATE, b"")
