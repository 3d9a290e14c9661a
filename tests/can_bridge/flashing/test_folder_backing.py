"""The store's place in a folder; `tests/proofs/flash` cuts its supply."""

import os

import pytest

from can_bridge.flashing.backing import MediumError, RecordKind, Slot, at_once
from can_bridge.flashing.folder_backing import FolderBacking


def test_it_outlives_the_process(tmp_path):
    backing = FolderBacking(tmp_path / "ecu")
    at_once(backing.clear(Slot.B))
    backing.append(Slot.B, b"first ")
    backing.keep(RecordKind.STATE, b"state")
    backing.append(Slot.B, b"lost")
    again = FolderBacking(tmp_path / "ecu")
    assert again.records() == {RecordKind.STATE: b"state"}
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
    at_once(backing.clear(Slot.A))
    with pytest.raises(MediumError, match="has room for only 10 bytes"):
        backing.append(Slot.A, bytes(11))
    with pytest.raises(MediumError, match="has 0 bytes: must have 5 or more"):
        backing.begin_again(Slot.A, 5)
    # A FIFO has to be refused, not waited for.
    for name in ("state.record", "slot_b.image"):
        os.mkfifo(tmp_path / "folder" / name)
    for use in (backing.records, lambda: backing.read(Slot.B, 0, 1), lambda: next(iter(backing.clear(Slot.B)))):
        with pytest.raises(MediumError, match=r"store .*: (must be a regular file|No such device)"):
            use()
    (tmp_path / "folder" / "record.new").mkdir()
    with pytest.raises(MediumError, match=r"record\.new"):
        backing.keep(RecordKind.STATE, b"")
