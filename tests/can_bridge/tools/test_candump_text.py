"""The notation against python-can's reader of candump files."""

from contextlib import suppress

import can
from hypothesis import given
from hypothesis import strategies as st

from can_bridge.tools.candump_text import parse
from can_bridge.wire.frame import FD_LENGTHS
from contract.errors import BusError
from tests.examples import examples
from tests.refused import refused


@examples(40)
@given(
    identifier=st.integers(0, 0x7FF).map("{:03X}".format) | st.integers(0, 0x1FFFFFFF).map("{:08x}".format),
    rest=st.binary(max_size=8).map(lambda data: f"#{data.hex()}")
    | st.integers(0, 8).map("#R{}".format)
    | st.tuples(st.integers(0, 3), st.sampled_from(FD_LENGTHS)).map(lambda one: f"##{one[0]}{'5a' * one[1]}"),
)
def test_the_same_as_python_can_reads(tmp_path_factory, identifier, rest):
    path = tmp_path_factory.mktemp("log") / "a.log"
    path.write_text(f"(0.0) can0 {identifier}{rest}\n")
    with can.LogReader(path) as reader:
        (wanted,) = reader
    assert parse(identifier + rest).equals(wanted, timestamp_delta=None, check_channel=False)


def test_short_forms():
    for text, dlc in [("123#R", 0), ("123#r8", 8), ("123#11.22.33", 3), ("00000123#", 0)]:
        assert parse(text).dlc == dlc, (text, dlc)


def test_refused():
    for text in ("", "123", "12#", "1234#", "123#1", "123#R9", "123##", "123##4", "xyz#00"):
        with refused(BusError, f"{text}: must be ID#DATA"):
            parse(text)
    for text, words in [
        ("800#00", "the identifier must be in 0..7FF"),
        ("20000000#00", "the identifier must be in 0..1FFFFFFF"),
        ("123#" + "00" * 9, "has 9 bytes; a frame of its kind has 0, 1"),
        ("123##1" + "00" * 9, "has 9 bytes"),
        ("123##1" + "00" * 65, "has 65 bytes"),
    ]:
        with refused(BusError, words):
            parse(text)


@given(st.text())
def test_nothing_typed_makes_it_fail_otherwise(text):
    with suppress(BusError):
        parse(text)
