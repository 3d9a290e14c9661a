"""Containers that state one size and hold another: what is read is bounded, whatever they say."""

import io
import os
import struct
import time
import tracemalloc
import zipfile
from pathlib import Path

import pytest

from contract.errors import BundleContainerError
from contract.release import container
from contract.release.container import MAX_DIRECTORY, MAX_FILES, MAX_ZIP, is_plain_name, read_files

SECONDS = 1.0
MEMORY = 100 * 2**20
"""More memory than this no bundle may take, sound or not: three times the content of the greatest one."""


def refused(path: Path) -> str:
    """The message, after a check of time and memory."""
    began = time.process_time()
    tracemalloc.start()
    try:
        with pytest.raises(BundleContainerError) as error:
            read_files(path)
        _, peak = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert time.process_time() - began < SECONDS
    assert peak < MEMORY
    assert "\n" not in str(error.value)
    return str(error.value)


def understated(path: Path, size: int, stated: int) -> Path:
    """A zip of zeros whose headers state fewer bytes than it inflates to."""
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive, archive.open("zeros", "w") as file:
        for _ in range(size // 2**20):
            file.write(bytes(2**20))
    raw = path.read_bytes()
    assert raw.count(struct.pack("<I", size)) >= 1
    path.write_bytes(raw.replace(struct.pack("<I", size), struct.pack("<I", stated)))
    return path


def test_a_hundred_megabytes_that_call_themselves_a_hundred_bytes(tmp_path):
    path = understated(tmp_path / "b.zip", 100 * 2**20, 100)
    assert path.stat().st_size < 120_000
    assert "damaged" in refused(path) or "at most" in refused(path)


def many_entries(path: Path, count: int, zip64: bool) -> Path:
    """A zip of nothing but a central directory: empty files of one-letter names, all at the same place."""
    local = struct.pack("<IHHHHHIIIHH", 0x04034B50, 20, 0, 0, 0, 33, 0, 0, 0, 1, 0) + b"x"
    entry = struct.pack("<IHHHHHHIIIHHHHHII", 0x02014B50, 20, 20, 0, 0, 0, 33, 0, 0, 0, 1, 0, 0, 0, 0, 0, 0) + b"x"
    directory = entry * count
    start, size = len(local), len(directory)
    end = b""
    if zip64:
        end = struct.pack("<IQHHIIQQQQ", 0x06064B50, 44, 45, 45, 0, 0, count, count, size, start)
        end += struct.pack("<IIQI", 0x07064B50, 0, start + size, 1)
    short = min(count, 0xFFFF)
    end += struct.pack("<IHHHHIIH", 0x06054B50, 0, 0, short, short, *(2 * [0xFFFFFFFF] if zip64 else [size, start]), 0)
    path.write_bytes(local + directory + end)
    return path


def test_zips_may_have_comments_and_no_passwords(tmp_path):
    path = tmp_path / "b.zip"
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("a", b"content")
        archive.comment = b"c" * 65_535
    assert read_files(path) == {"a": b"content"}
    # An encrypted zip is refused.
    content = io.BytesIO()
    with zipfile.ZipFile(content, "w") as archive:
        archive.writestr("a", b"content")
    raw = bytearray(content.getvalue())
    for signature, flags in ((b"PK\x03\x04", 6), (b"PK\x01\x02", 8)):
        raw[raw.index(signature) + flags] |= 1
    (tmp_path / "b.zip").write_bytes(raw)
    assert "encrypted" in refused(tmp_path / "b.zip")


def test_a_folder_of_many_files_is_refused(tmp_path):
    for i in range(3 * MAX_FILES):
        (tmp_path / f"{i}").touch()
    assert f"more than {MAX_FILES} files" in refused(tmp_path)


def test_a_file_that_becomes_a_pipe_or_a_link_is_not_waited_for(tmp_path):
    """The folder may change between the look and the reading."""
    os.mkfifo(tmp_path / "pipe")
    (tmp_path / "link").symlink_to("/etc/passwd")
    for name, named in (("pipe", "not a plain file"), ("link", "is a symbolic link")):
        with pytest.raises(BundleContainerError, match=named):
            container._open_plain(tmp_path, name)


def test_a_directory_of_many_entries_is_refused_before_it_is_parsed(tmp_path):
    """500,000 entries are parsed in some seconds; that a few are read shows that the file is a zip."""
    for zip64 in (False, True):
        assert zipfile.ZipFile(many_entries(tmp_path / "few.zip", 10, zip64)).namelist() == ["x"] * 10
        path = many_entries(tmp_path / "b.zip", 500_000, zip64)
        assert f"its central directory has 23500000 bytes: at most {MAX_DIRECTORY}" in refused(path), zip64


def test_sparse_files_are_not_read_to_their_end(tmp_path):
    for name, size in (("b.zip", MAX_ZIP + 1), ("manifest.json", 2**40)):
        with (tmp_path / name).open("wb") as file:
            file.truncate(size)
    assert f"has {MAX_ZIP + 1} bytes: at most {MAX_ZIP}" in refused(tmp_path / "b.zip")
    (tmp_path / "b.zip").unlink()
    assert "manifest.json is too large: at most 1048576" in refused(tmp_path)


def test_a_name_that_a_terminal_would_obey_is_refused_and_escaped(tmp_path):
    names = ["\x1b[2Jx", "a\nb", "x" * 101, "\u202egnp", os.fsdecode(b"\xff\xfe")]
    for number, name in enumerate(names):
        folder = tmp_path / str(number)
        folder.mkdir()
        (folder / name).touch()
        assert not is_plain_name(name)
        assert refused(folder).isprintable(), name
        if name != names[-1]:
            with zipfile.ZipFile(tmp_path / "b.zip", "w") as archive:
                archive.writestr(name, b"")
            assert refused(tmp_path / "b.zip").isprintable(), name
