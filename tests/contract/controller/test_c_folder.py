"""The C library's folder: what one room writes another one reads, and what is no such folder is named."""

import os

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import array_shapes, arrays

from contract.controller import c_folder
from contract.errors import LibraryError

finite = st.floats(width=32, allow_nan=False, allow_infinity=False)


def test_settings_are_read_as_they_were_written():
    header = c_folder.settings_header({"SW_WINDOW": 20, "SW_ACTION_LIMIT": np.float32(0.075)})
    settings = c_folder.ProgramSettings.of({c_folder.PROGRAM_SETTINGS: header})
    assert (settings.number("SW_WINDOW"), settings.text("SW_ACTION_LIMIT")) == (20, "7.5e-02f")
    with pytest.raises(LibraryError, match=r"sw_settings\.h: SW_HORIZON is missing"):
        settings.number("SW_HORIZON")
    # A size that is none is named.
    for value in ("-1", "1.5", "x", "9" * 5000, "\x1b[2J"):
        settings = c_folder.ProgramSettings(f"#define SW_WINDOW {value}\n".encode())
        with pytest.raises(LibraryError, match=r"SW_WINDOW is .*: must be a whole number") as refused:
            settings.number("SW_WINDOW")
        assert str(refused.value).isprintable()


@given(finite)
def test_a_literal_is_its_float32_again(value):
    number = np.float32(value)
    literal = c_folder.float_literal(number)
    assert literal[-1] == "f" and "." in literal
    assert np.float32(literal[:-1]) == number


@given(arrays(np.float32, array_shapes(min_dims=2, max_dims=2), elements=finite))
def test_rows_are_read_to_the_bit_as_they_were_written(rows):
    np.testing.assert_array_equal(c_folder.rows_from_text(c_folder.rows_text(rows)), rows)


def test_a_folder_is_read_as_it_was_written_and_replaces_no_other(tmp_path):
    contents = {
        c_folder.PROGRAM_SETTINGS: b"",
        "a.c": b"int a;",
        c_folder.REPLAY: b"int main(void);",
        c_folder.RECORDED: b"1 2\n3 4\n",
    }
    c_folder.write_folder(tmp_path / "c", contents)
    sources = c_folder.read_sources(tmp_path / "c")
    assert sources == {name: content for name, content in contents.items() if name != c_folder.RECORDED}
    assert set(c_folder.library_sources(sources)) == {c_folder.PROGRAM_SETTINGS, "a.c"}
    np.testing.assert_array_equal(c_folder.read_recorded(tmp_path / "c"), [[1, 2], [3, 4]])
    (tmp_path / "thesis.txt").write_text("years of work")
    with pytest.raises(LibraryError, match="holds other files"):
        c_folder.write_folder(tmp_path, {c_folder.PROGRAM_SETTINGS: b""})
    assert (tmp_path / "thesis.txt").read_text() == "years of work"


@given(st.text(st.characters(min_codepoint=32, exclude_categories=["Cs", "Cc", "Zl", "Zp"]), max_size=20))
def test_any_name_is_read_as_it_was_written(text):
    """Quotation marks, backslashes and what C99 would take for a trigraph included."""
    header = c_folder.settings_header({"SW_SENSOR_NAMES": text})
    assert b"??" not in header
    assert c_folder.ProgramSettings(header).text("SW_SENSOR_NAMES") == text


def test_files_that_are_missing_damaged_or_without_end_are_refused(tmp_path):
    with pytest.raises(LibraryError, match=r"nowhere: No such file"):
        c_folder.read_sources(tmp_path / "nowhere")
    with pytest.raises(LibraryError, match=r"sw_settings\.h is missing"):
        c_folder.ProgramSettings.of({})
    (tmp_path / c_folder.RECORDED).write_text("1 2\n3 four\n")
    with pytest.raises(LibraryError, match=r"recorded\.txt: .*four"):
        c_folder.read_recorded(tmp_path)
    for name in ("a.c", c_folder.RECORDED):
        with (tmp_path / name).open("wb") as file:
            file.truncate(2**40)
    for read in (c_folder.read_sources, c_folder.read_recorded):
        with pytest.raises(LibraryError, match="more than 67108864 bytes"):
            read(tmp_path)
    (tmp_path / "a.c").unlink()
    os.mkfifo(tmp_path / "a.c")
    with pytest.raises(LibraryError, match=r"'a\.c' is not a plain file"):
        c_folder.read_sources(tmp_path)
