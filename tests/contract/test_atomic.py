import os
import re
import stat
from pathlib import Path

import pytest

from contract.atomic import check_writable, replacing
from contract.errors import StillwakeError


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


def test_it_appears_whole_or_leaves_the_old_one_and_nothing_else(tmp_path):
    for write in (Path.write_text, write_directory):
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


def test_a_place_is_refused_before_the_work_or_left_as_it_was(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "file").write_text("in the way")
    (tmp_path / "folder").mkdir()
    for place, is_folder in (("file", False), ("folder", True), ("new/deep/file", False), ("new/deep/folder", True)):
        check_writable(tmp_path / place, folder=is_folder)
    for target, folder, reason in (
        ("folder", False, "it is a directory, must be a file"),
        ("file", True, "it is a file, must be a directory"),
        ("file/inside", False, "Not a directory"),
        ("folder/..", True, "name a new folder in this directory"),
        ("n" * 250, False, "File name too long"),
        ("/proc/self/stillwake.npz", False, ""),
        ("/dev/null", False, "neither a file nor a directory"),
    ):
        with pytest.raises(StillwakeError, match=f"^cannot write {re.escape(target)}: .*{reason}"):
            check_writable(Path(target), folder=folder)
        assert sorted(item.name for item in tmp_path.rglob("*")) == ["file", "folder"], target
    with pytest.raises(StillwakeError, match="file/target"), replacing(tmp_path / "file" / "target"):
        pytest.fail("nothing can be written here")
    assert (tmp_path / "file").read_text() == "in the way"


def mode(path: Path) -> int:
    return stat.S_IMODE(path.stat().st_mode)


def test_what_a_link_leads_to_is_replaced_and_keeps_its_mode(tmp_path):
    """Also through a chain, through a folder on the way, and where there is nothing yet; the links stay."""
    before = os.umask(0o027)
    try:
        for write, old_mode, new_mode in ((Path.write_text, 0o604, 0o640), (write_directory, 0o705, 0o750)):
            place = tmp_path / write.__name__
            (place / "real").mkdir(parents=True)
            (place / "way").symlink_to("real")
            (place / "link").symlink_to("way/target")
            (place / "chain").symlink_to(place / "link")
            target = place / "real" / "target"
            for text, path in enumerate(("chain", "link", "way/target", "real/target", "chain")):
                check_writable(place / path, folder=write is write_directory)
                with replacing(place / path) as temporary:
                    assert temporary.parent == target.parent, "on the same file system"
                    write(temporary, str(text))
                assert content(target) == content(place / "chain") == str(text)
                assert mode(target) == (old_mode if text else new_mode)
                target.chmod(old_mode)
                if target.is_dir():
                    (target / "inside").chmod(0o600)
                    assert text == 0 or mode(target / "inside") == 0o600
            assert (place / "link").readlink() == Path("way/target") and (place / "chain").is_symlink()
            assert [item.name for item in target.parent.iterdir()] == ["target"]
        # A directory that keeps what else is in it.
        with replacing(tmp_path / "write_directory" / "chain", keep=True) as temporary:
            write_directory(temporary, "kept")
            (temporary / "more").write_text("")
        modes = [mode(path) for path in (target, target / "inside", target / "more")]
        assert (content(target), modes) == ("kept", [0o705, 0o600, 0o640])
    finally:
        os.umask(before)


def test_a_place_that_would_not_show_what_is_written_is_refused(tmp_path, capfd):
    (tmp_path / "file").write_text("old")
    (tmp_path / "other").hardlink_to(tmp_path / "file")
    (tmp_path / "round").symlink_to("round")
    (tmp_path / "gone").symlink_to("disk/results")
    (tmp_path / "file_link").symlink_to("other")
    os.mkfifo(tmp_path / "fifo")
    (tmp_path / "fifo_link").symlink_to("fifo")
    there = sorted(tmp_path.iterdir())
    for name, reason in (
        ("other", r"the file has 2 names \(hard links\), and the other names would keep the old content"),
        ("file_link", r"the file has 2 names"),
        ("round", "Too many levels of symbolic links"),
        ("gone", r".*gone is a link to disk/results, which does not exist"),
        ("gone/run", r".*gone is a link to disk/results, which does not exist"),
        ("fifo", "it is neither a file nor a directory"),
        ("fifo_link", "it is neither a file nor a directory"),
        ("/dev/stdout", "this command prints to it; name another file"),
        ("/dev/fd/2", "this command prints to it"),
    ):
        with pytest.raises(StillwakeError, match=f"^cannot write {tmp_path / name}: {reason}"):
            check_writable(tmp_path / name, folder=name == "gone/run")
        if name.startswith("gone"):
            with pytest.raises(StillwakeError, match="does not exist"), replacing(tmp_path / name):
                pytest.fail("nothing can be written here")
    assert sorted(tmp_path.iterdir()) == there
