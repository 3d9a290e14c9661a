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


WRITERS = [write_file, write_directory]


def content(place: Path) -> str:
    return (place / "inside" if place.is_dir() else place).read_text()


@pytest.mark.parametrize("write", WRITERS)
def test_appears_whole_and_replaces_the_old(tmp_path, write):
    target = tmp_path / "deep" / "target"
    for text in ("one", "two"):
        with replacing(target) as temporary:
            write(temporary, text)
        assert content(target) == text
    assert [item.name for item in target.parent.iterdir()] == ["target"]


@pytest.mark.parametrize("error", [RuntimeError, KeyboardInterrupt])
@pytest.mark.parametrize("write", WRITERS)
def test_failure_leaves_the_old_one_and_nothing_else(tmp_path, write, error):
    target = tmp_path / "target"
    write(target, "old")
    with pytest.raises(error), replacing(target) as temporary:
        write(temporary, "half")
        raise error
    assert content(target) == "old"
    assert [item.name for item in tmp_path.iterdir()] == ["target"]


def test_a_folder_made_for_nothing_goes_again(tmp_path):
    with pytest.raises(KeyboardInterrupt), replacing(tmp_path / "new" / "target") as temporary:
        temporary.write_text("half")
        raise KeyboardInterrupt
    assert list(tmp_path.iterdir()) == []
    (tmp_path / "old").mkdir()
    with pytest.raises(KeyboardInterrupt), replacing(tmp_path / "old" / "target"):
        raise KeyboardInterrupt
    assert (tmp_path / "old").is_dir()


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


def test_place_that_cannot_be_written_is_named(tmp_path):
    (tmp_path / "file").write_text("in the way")
    target = tmp_path / "file" / "target"
    with pytest.raises(StillwakeError, match=str(target)), replacing(target):
        pytest.fail("nothing can be written here")


def test_a_place_that_can_be_written_is_left_as_it_was(tmp_path):
    (tmp_path / "old").mkdir()
    (tmp_path / "file").write_text("old")
    check_writable(tmp_path / "file")
    check_writable(tmp_path / "old", folder=True)
    check_writable(tmp_path / "new" / "deep" / "file")
    check_writable(tmp_path / "new" / "deep" / "folder", folder=True)
    assert sorted(item.name for item in tmp_path.rglob("*")) == ["file", "old"]
    assert (tmp_path / "file").read_text() == "old"


@pytest.mark.parametrize(
    ("target", "folder", "reason"),
    [
        ("folder", False, "it is a directory, must be a file"),
        ("file", True, "it is a file, must be a directory"),
        ("file/inside", False, "Not a directory"),
        ("file/deeper/inside", True, "Not a directory"),
        ("folder/..", True, "name a new folder in it"),
        ("n" * 250, False, "File name too long"),
        ("/proc/self/stillwake.npz", False, ""),
        ("/dev/null", False, "neither a file nor a directory"),
    ],
)
def test_a_place_that_cannot_be_written_is_refused_before_the_work(tmp_path, target, folder, reason):
    (tmp_path / "file").write_text("in the way")
    (tmp_path / "folder").mkdir()
    path = tmp_path / target
    with pytest.raises(StillwakeError, match=f"^cannot write {re.escape(str(path))}: .*{reason}"):
        check_writable(path, folder=folder)
    assert sorted(item.name for item in tmp_path.rglob("*")) == ["file", "folder"]


def test_the_working_folder_itself_is_no_place_for_a_result(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(StillwakeError, match=r"cannot write \.: name a new folder in it"):
        check_writable(Path(), folder=True)
