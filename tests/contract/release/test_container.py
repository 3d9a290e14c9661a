"""Folders, images and graphs that are no bundle's are refused in bounded time and memory; an image has its layout."""

import os
import struct
import time
import tracemalloc
import zipfile
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from onnx import helper

from contract.errors import BundleContainerError, BundleControllerError
from contract.release import container
from contract.release.checks import CONTROLLER, MAX_GRAPH_BYTES, check_graph
from contract.release.container import files_of, image_of, is_plain_name, read_files
from contract.shipped import BUNDLE
from tests.contract.controller.graphs import constant, graph_of, outside
from tests.examples import examples

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
    assert time.process_time() - began < 1.0
    assert peak < MEMORY
    assert "\n" not in str(error.value)
    return str(error.value)


def test_a_file_is_no_bundle_and_a_zip_of_an_older_version_is_told_from_others(tmp_path):
    path = tmp_path / "b.zip"
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("a", b"content")
    assert f"{path}: must be a directory; unpack it: python -m zipfile -e {path} FOLDER" in refused(path)
    zipfile.main(["-e", str(path), str(tmp_path / "b")])  # type: ignore[attr-defined]  # behind `python -m zipfile`
    assert read_files(tmp_path / "b") == {"a": b"content"}
    (tmp_path / "b.swi").write_bytes(b"SWCTRL01")
    assert refused(tmp_path / "b.swi").endswith("b.swi: must be a directory")


def test_a_file_that_becomes_a_pipe_or_a_link_is_not_waited_for(tmp_path):
    """The folder may change between the look and the reading."""
    os.mkfifo(tmp_path / "pipe")
    (tmp_path / "link").symlink_to("/etc/passwd")
    for name, named in (("pipe", "not a plain file"), ("link", "is a symbolic link")):
        with pytest.raises(BundleContainerError, match=named):
            container._open_plain(tmp_path, name)


def test_sparse_files_are_not_read_to_their_end(tmp_path):
    with (tmp_path / "manifest.json").open("wb") as file:
        file.truncate(2**40)
    assert "manifest.json is too large: must have at most 1048576" in refused(tmp_path)


def test_a_name_that_a_terminal_would_obey_is_refused_and_escaped(tmp_path):
    names = ["\x1b[2Jx", "a\nb", "x" * 101, "\u202egnp", os.fsdecode(b"\xff\xfe")]
    for number, name in enumerate(names):
        folder = tmp_path / str(number)
        folder.mkdir()
        (folder / name).touch()
        assert not is_plain_name(name)
        assert refused(folder).isprintable(), name


def test_what_reads_files_or_is_not_onnxs_own_is_refused_wherever_it_stands():
    # The tensor is one level deeper than the graph's own constants.
    in_an_attribute = helper.make_node("Constant", [], ["x"], value=outside())
    body = graph_of([in_an_attribute]).graph
    for content, named in (
        (graph_of((), [outside()]), "a constant is in another file"),
        (graph_of([in_an_attribute]), "a constant is in another file"),
        (graph_of([helper.make_node("If", ["plan"], ["x"], then_branch=body, else_branch=body)]), "another file"),
        (graph_of([helper.make_node("Gelu", ["plan"], ["x"], domain="com.microsoft")]), "Runtime's domain"),
        (graph_of([helper.make_node("Scaler", ["plan"], ["x"], domain="ai.onnx.ml")]), "default domain"),
        (graph_of((), [constant("c", np.zeros(MAX_GRAPH_BYTES // 4))]), f"at most {MAX_GRAPH_BYTES}"),
    ):
        with pytest.raises(BundleControllerError, match=named):
            check_graph(BUNDLE, CONTROLLER, content.SerializeToString())
    check_graph(BUNDLE, CONTROLLER, graph_of().SerializeToString())
    check_graph(BUNDLE, CONTROLLER, (BUNDLE / CONTROLLER).read_bytes())


SMALL = {"manifest.json": b"{}", "manifest.sig": b"sig", "b": b"", "a": b"12"}
BY_HAND = (
    b"SWIMAGE1" + bytes.fromhex("0000004a 00000004")
    + bytes.fromhex("000d 00000002") + b"manifest.json" + bytes.fromhex("000c 00000003") + b"manifest.sig"
    + bytes.fromhex("0001 00000002") + b"a" + bytes.fromhex("0001 00000000") + b"b"
    + b"{}sig12"
)  # fmt: skip
"""The layout of an image, written down from its description."""


def entry(name: bytes, size: int) -> bytes:
    return struct.pack(">HI", len(name), size) + name


def an_image(*entries: bytes, contents: bytes = b"", count: int | None = None) -> bytes:
    """Of any list of files, with the length that fits."""
    body = b"".join(entries) + contents
    return b"SWIMAGE1" + struct.pack(">II", 16 + len(body), len(entries) if count is None else count) + body


def test_the_layout_is_as_described():
    assert image_of(SMALL) == BY_HAND
    assert files_of(BY_HAND) == SMALL
    # The shipped release has an image whose manifest comes first.
    files = read_files(BUNDLE)
    image = image_of(files)
    assert list(files_of(image)) == ["manifest.json", "manifest.sig", "controller.onnx", "sensors.onnx"]
    assert files_of(image) == files


def test_what_is_no_image_is_refused_in_one_line():
    for image, message in (
        (b"", "the image has 0 bytes: must have 16 or more"),
        (b"SWIMAGE2" + BY_HAND[8:], "begins with 5357494d41474532: must begin with 5357494d41474531"),
        (an_image(count=65), "the image has 65 files: must have at most 64"),
        (an_image(count=1), "ends within its list"),
        (an_image(entry(b"a", 2**32 - 1)), "its files end at"),
        (an_image(entry(b"a", 0), entry(b"a", 0)), "'a' must be a plain file name, and must occur once"),
        (an_image(entry(b"../a", 0)), "'../a' must be a plain"),
        (an_image(entry(b"a\x1b[2J", 0)), "must be a plain"),
        (an_image(entry(b"\xff", 0)), "not UTF-8"),
    ):
        with pytest.raises(BundleContainerError, match=message) as refused:
            files_of(image)
        assert str(refused.value).isprintable()
    # No truncated and no longer image is read.
    for length in range(len(BY_HAND)):
        with pytest.raises(BundleContainerError):
            files_of(BY_HAND[:length])
    with pytest.raises(BundleContainerError, match="states"):
        files_of(BY_HAND + b"\0")


@examples(200)
@given(st.binary(max_size=200))
def test_any_bytes_are_refused_or_are_files(tail):
    image = b"SWIMAGE1" + struct.pack(">I", 12 + len(tail)) + tail
    try:
        files = files_of(image)
    except BundleContainerError:
        return
    assert sum(map(len, files.values())) <= len(image)
