"""Whose a recording's unfinished folder is, and what is left when a call on it ends anywhere."""

from pathlib import Path

import pytest

from contract.errors import StillwakeError
from wake.recording.parts_folder import PartsFolder

TASK = {"plans": [1, 2], "block_steps": 3}


@pytest.fixture
def parts(tmp_path) -> PartsFolder:
    return PartsFolder.for_output(tmp_path / "a.h5")


def test_it_stands_next_to_its_output_by_an_absolute_path(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert PartsFolder.for_output(Path("a.h5")).path == tmp_path / "a.h5.parts"


def test_the_last_call_that_claims_it_owns_it(parts):
    assert not parts.is_owned_by("one")
    parts.claim(TASK, "one")
    assert parts.is_owned_by("one")
    parts.claim(TASK, "two")
    assert parts.is_owned_by("two") and not parts.is_owned_by("one")
    parts.disown("one")
    assert parts.is_owned_by("two")
    parts.disown("two")
    assert not parts.is_owned_by("two")
    parts.disown("two")


def test_it_stays_as_soon_as_a_block_is_recorded(parts):
    parts.claim(TASK, "one")
    (parts.path / "episode").mkdir()
    # The state is written before the samples it belongs to.
    (parts.path / "episode" / "000000.state.npz").write_bytes(b"")
    parts.disown("one")
    assert not parts.path.exists()
    parts.claim(TASK, "two")
    (parts.path / "episode").mkdir()
    (parts.path / "episode" / "000000.npz").write_bytes(b"")
    parts.disown("two")
    assert parts.has_samples
    assert parts.task() == TASK
    # Also after a clearing that was stopped.
    parts.path.with_name(parts.path.name + ".done").mkdir()
    parts.clear()
    assert list(parts.path.parent.iterdir()) == []


def test_only_the_same_task_continues_what_was_begun(parts):
    parts.claim(TASK, "one")
    # As long as nothing is recorded, another task may have the folder.
    parts.claim(TASK | {"block_steps": 4}, "two")
    assert parts.task() == TASK | {"block_steps": 4}
    (parts.path / "episode").mkdir()
    with pytest.raises(StillwakeError, match=r"other settings \(block_steps\): finish it with those, or delete it"):
        parts.claim(TASK, "three")
    assert parts.is_owned_by("two")
    parts.claim(TASK | {"block_steps": 4}, "four")
    assert parts.is_owned_by("four")


def test_parts_without_a_readable_label_are_refused(parts):
    for label in [None, "{", "nonsense"]:
        (parts.path / "episode").mkdir(parents=True, exist_ok=True)
        if label is not None:
            (parts.path / "task.json").write_text(label)
        assert parts.task() is None
        with pytest.raises(StillwakeError, match="unknown recording: delete it first"):
            parts.claim(TASK, "one")
