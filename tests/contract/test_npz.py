"""What an NPZ file holds is bounded by its directory and its headers, before anything of it is read."""

import io
import tracemalloc
from zipfile import ZIP_DEFLATED, ZipFile

import numpy as np
import pytest

from contract.npz import read_npz

MOST_VALUES = 2**22
"""For these tests: more than the memory that they allow."""


def npy(header: str, content: bytes = b"") -> bytes:
    text = header.encode()
    return b"\x93NUMPY\x01\x00" + len(text).to_bytes(2, "little") + text + content


def test_arrays_come_back_as_they_were_and_can_be_changed(tmp_path):
    arrays = {"f": np.asfortranarray(np.arange(6.0).reshape(2, 3)), "none": np.zeros((0, 3)), "text": np.array("ä")}
    np.savez_compressed(tmp_path / "a.npz", **arrays)  # type: ignore[arg-type]  # numpy's stub takes names for options
    found = read_npz(tmp_path / "a.npz")
    assert found["none"].shape == (0, 3) and found.text("text") == "ä"
    assert np.array_equal(found.numbers("f", None, 3), arrays["f"])
    found["f"][0, 0] = 7.0
    for name, shape in (("f", (3, 2)), ("f", (6,)), ("text", ()), ("more", ())):
        with pytest.raises(ValueError, match=name):
            found.numbers(name, *shape)


def test_what_is_too_large_or_would_have_to_be_unpickled_is_refused_before_it_is_read(tmp_path, monkeypatch):
    monkeypatch.setattr("contract.npz.MOST_VALUES", MOST_VALUES)
    path, pickled = tmp_path / "a.npz", io.BytesIO()
    np.save(pickled, np.array([{}], dtype=object))
    large = f"{{'descr': '|u1', 'fortran_order': False, 'shape': ({MOST_VALUES + 1},)}}"
    for member, reason in (
        (npy(large, bytes(MOST_VALUES + 1)), f"holds {MOST_VALUES + 1} values: must be at most"),
        (npy(large), "its size does not match"),
        (pickled.getvalue(), "holds Python objects, which are not read"),
        (npy("[" * 9000), "damaged or not an NPZ"),
        (b"", "damaged or not an NPZ"),
    ):
        with ZipFile(path, "w", compression=ZIP_DEFLATED) as file:
            file.writestr("a.npy", member)
        tracemalloc.start()
        with pytest.raises(ValueError, match=reason) as caught:
            read_npz(path)
        assert tracemalloc.get_traced_memory()[1] < 3_000_000
        tracemalloc.stop()
        assert "pickle" not in str(caught.value)
    with pytest.raises(ValueError, match="it is not a file"):
        read_npz(tmp_path)
