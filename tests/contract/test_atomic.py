import re
from pathlib import Path

import pytest

from contract.atomic import check_writable, replacing
from contract.errors import StillwakeError


def write_file(place: Path, text: str) -> None:
    place.write_text(text)


def write_directory(place: Path, text: str) -> None:
    place.mkdir()
    (place / "inside").write_text(text)


def content(place: Path) -> str:
    return (place / "inside" if place.is_dir() else place).read_text()


def test_interrupted_move_puts_the_old_directory_back(tmp_path, monkeypatch):
    target = tmp_path / "target"
    write_directory(target, "old")
    move = Path.replace

    def interrupted(self: Path, to: Path) -> Path:
        if self.name.endswith(".part"):
            raise KeyboardInterrupt
        return move(self, to)

    monkeypatch.setattr(Path, "replace", interrupted)
    with pytest.raises(KeyboardInterrupt), replacing(target) as temporary:
        write_directory(temporary, "new")
    assert content(target) == "old"
    assert [item.name for item in tmp_path.iterdir()] == ["target"]


def test_a_place_that_can_be_written_is_left_as_it_was(tmp_path):
    (tmp_path / "old").mkdir()
    (tmp_path / "file").write_text("old")
    for place, folder in (("file", False), ("old", True), ("new/deep/file", False), ("new/deep/folder", True)):
        check_writable(tmp_path / place, folder=folder)
    assert sorted(item.name for item in tmp_path.rglob("*")) == ["file", "old"]
    assert (tmp_path / "file").read_text() == "old"


def test_it_appears_whole_or_leaves_the_old_one_and_nothing_else(tmp_path):
    for write in (write_file, write_directory):
        target = tmp_path / write.__name__ / "target"
        for text in ("one", "two"):
            with replacing(target) as temporary:
                write(temporary, text)
            assert content(target) == text
        for error in (RuntimeError, KeyboardInterrupt):
            with pytest.raises(error), replacing(target) as temporary:
                write(temporary, "half")
                raise error
            assert content(target) == "two"
        assert [item.name for item in target.parent.iterdir()] == ["target"]
    # A folder that was made for nothing goes again.
    with pytest.raises(KeyboardInterrupt), replacing(tmp_path / "new" / "target") as temporary:
        temporary.write_text("half")
        raise KeyboardInterrupt
    assert not (tmp_path / "new").exists()


def test_a_place_that_cannot_be_written_is_refused_before_the_work(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "file").write_text("in the way")
    (tmp_path / "folder").mkdir()
    for target, folder, reason in (
        ("folder", False, "it is a directory, must be a file"),
        ("file", True, "it is a file, must be a directory"),
        ("file/inside", False, "Not a directory"),
        ("folder/..", True, "name a new folder in it"),
        ("n" * 250, False, "File name too long"),
        ("/proc/self/stillwake.npz", False, ""),
        ("/dev/null", False, "neither a file nor a directory"),
    ):
        path = Path(target)
        with pytest.raises(StillwakeError, match=f"^cannot write {re.escape(str(path))}: .*{reason}"):
            check_writable(path, folder=folder)
        assert sorted(item.name for item in tmp_path.rglob("*")) == ["file", "folder"], target
    with pytest.raises(StillwakeError, match="file/target"), replacing(tmp_path / "file" / "target"):
        pytest.fail("nothing can be written here")
