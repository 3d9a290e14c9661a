import struct

import pytest
from hypothesis import given
from hypothesis import strategies as st

from contract.errors import BundleContainerError
from contract.release.container import files_of, image_of, read_files
from contract.shipped import BUNDLE
from tests.examples import examples

SMALL = {"manifest.json": b"{}", "manifest.sig": b"sig", "b": b"", "a": b"12"}


BY_HAND = (
    b"SWIMAGE1" + bytes.fromhex("0000004a 00000004")
    + bytes.fromhex("000d 00000002") + b"manifest.json" + bytes.fromhex("000c 00000003") + b"manifest.sig"
    + bytes.fromhex("0001 00000002") + b"a" + bytes.fromhex("0001 00000000") + b"b"
    + b"{}sig12"
)  # fmt: skip
"""The layout of `contract.release.container`, written down from its description."""


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
        (b"", "image of 0 bytes: must have 16 or more"),
        (b"SWIMAGE2" + BY_HAND[8:], "begins with 5357494d41474532: must begin with 5357494d41474531"),
        (an_image(count=65), "image of 65 files: at most 64"),
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
