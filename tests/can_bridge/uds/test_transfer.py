"""Downloads block by block, through the server."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from can_bridge.uds.services import MAX_BLOCK, Nrc, Session
from tests.can_bridge.uds.scripted_ecu import MS, Bench, S, refused
from tests.examples import examples


@pytest.fixture
def bench() -> Bench:
    bench = Bench()
    bench.unlock()
    return bench


def begin(bench: Bench, length: int, offset: int = 0) -> bytes | None:
    return bench.ask(0x34, 0x00, 0x44, offset.to_bytes(4, "big"), length.to_bytes(4, "big"))


def written(bench: Bench) -> bytes:
    return b"".join(call[1] for call in bench.ecu.calls if call[0] == "transfer")


def test_download_says_how_long_a_block_may_be(bench):
    assert begin(bench, 10, offset=7) == bytes.fromhex("7420") + MAX_BLOCK.to_bytes(2, "big")
    assert bench.ecu.calls[-1] == ("download", 7, 10)


def test_wrong_download_requests(bench):
    for formats in ((0x10, 0x44), (0x01, 0x44), (0x00, 0x33), (0x00, 0x24)):
        assert bench.ask(0x34, *formats, bytes(8)) == refused(0x34, Nrc.OUT_OF_RANGE), formats
    for length in (7, 9):
        assert bench.ask(0x34, 0x00, 0x44, bytes(length)) == refused(0x34, Nrc.INCORRECT_LENGTH)
    bench.ask(0x10, Session.PROGRAMMING)
    for raw in (b"\x34\x00\x44" + bytes(8), b"\x36\x01\x00", b"\x37"):
        assert bench.ask(raw) == refused(raw[0], Nrc.SECURITY_ACCESS_DENIED), raw


@given(blocks=st.lists(st.binary(min_size=1, max_size=8), min_size=1, max_size=5), repeats=st.data())
@examples(60)
def test_blocks_arrive_once_whatever_is_repeated(blocks, repeats):
    """A tester that misses an answer sends the same request again."""
    bench = Bench()
    bench.unlock()
    image = b"".join(blocks)
    for _ in range(repeats.draw(st.integers(1, 2))):
        assert begin(bench, len(image)) is not None
    for number, block in enumerate(blocks, start=1):
        for _ in range(repeats.draw(st.integers(1, 3))):
            assert bench.ask(0x36, number, block) == bytes([0x76, number])
    for _ in range(repeats.draw(st.integers(1, 2))):
        assert bench.ask(0x37) == b"\x77"
    assert written(bench) == image
    assert bench.ecu.calls.count(("exit",)) == 1


def test_counter_goes_from_255_to_0(bench):
    begin(bench, 600)
    for number in range(1, 601):
        assert bench.ask(0x36, number % 256, number % 251) == bytes([0x76, number % 256])
    assert written(bench) == bytes(number % 251 for number in range(1, 601))


def test_another_counter(bench):
    """The second block is due; counter 1 with other data is no repeated first one."""
    assert bench.ask(0x36, 1, b"abc") == refused(0x36, Nrc.SEQUENCE_ERROR)
    assert bench.ask(0x37) == refused(0x37, Nrc.SEQUENCE_ERROR)
    begin(bench, 10)
    assert bench.ask(0x36, 0, b"abc") == refused(0x36, Nrc.WRONG_BLOCK_COUNTER)
    bench.ask(0x36, 1, b"abc")
    for counter in (0, 1, 3, 255):
        assert bench.ask(0x36, counter, b"xyz") == refused(0x36, Nrc.WRONG_BLOCK_COUNTER), counter
    assert bench.ask(0x36, 2, b"xyz") == b"\x76\x02"
    assert written(bench) == b"abcxyz"


def test_more_bytes_than_asked_for(bench):
    begin(bench, 4)
    assert bench.ask(0x36, 1, b"abcde") == refused(0x36, Nrc.TRANSFER_SUSPENDED)
    assert bench.ask(0x36, 1, b"abcd") == b"\x76\x01"
    assert bench.ask(0x36, 2, b"e") == refused(0x36, Nrc.SEQUENCE_ERROR)
    assert written(bench) == b"abcd"


def test_longest_block(bench):
    begin(bench, MAX_BLOCK)
    assert bench.ask(0x36, 1, bytes(MAX_BLOCK - 1)) == refused(0x36, Nrc.INCORRECT_LENGTH)
    assert bench.ask(0x36, 1, bytes(MAX_BLOCK - 2)) == b"\x76\x01"


def test_exit(bench):
    begin(bench, 4)
    bench.ask(0x36, 1, b"abc")
    assert bench.ask(0x37) == refused(0x37, Nrc.SEQUENCE_ERROR)
    bench.ask(0x36, 2, b"d")
    bench.ecu.refusals["exit"] = Nrc.PROGRAMMING_FAILURE
    assert bench.ask(0x37) == refused(0x37, Nrc.PROGRAMMING_FAILURE)
    bench.ecu.refusals.clear()
    assert bench.ask(0x37) == b"\x77"
    assert bench.ask(0x36, 2, b"d") == refused(0x36, Nrc.SEQUENCE_ERROR)
    assert begin(bench, 1) is not None


def test_download_during_another(bench):
    begin(bench, 4)
    assert begin(bench, 5) == refused(0x34, Nrc.CONDITIONS_NOT_CORRECT)
    bench.ask(0x36, 1, b"a")
    assert begin(bench, 4) == refused(0x34, Nrc.CONDITIONS_NOT_CORRECT)


def test_what_ends_a_download(bench):
    begin(bench, 4)
    bench.ask(0x36, 1, b"a")
    bench.ask(0x31, 1, b"\xff\x00", bytes(36))
    assert bench.ask(0x36, 2, b"b") == refused(0x36, Nrc.SEQUENCE_ERROR), "an announcement"
    begin(bench, 5)
    bench.wait(5 * S)
    bench.unlock()
    assert bench.ask(0x36, 1, b"a") == refused(0x36, Nrc.SEQUENCE_ERROR), "the end of the session"
    bench.ecu.refusals["download"] = Nrc.OUT_OF_RANGE
    assert begin(bench, 4) == refused(0x34, Nrc.OUT_OF_RANGE)
    bench.ecu.refusals.clear()
    assert bench.ask(0x36, 1, b"a") == refused(0x36, Nrc.SEQUENCE_ERROR), "a refusal"
    begin(bench, 4)
    bench.ecu.refusals["transfer"] = Nrc.PROGRAMMING_FAILURE
    assert bench.ask(0x36, 1, b"a") == refused(0x36, Nrc.PROGRAMMING_FAILURE)
    bench.ecu.refusals.clear()
    assert bench.ask(0x36, 1, b"a") == refused(0x36, Nrc.SEQUENCE_ERROR), "a memory that fails"


def test_slow_block_is_repeated_while_it_is_written(bench):
    begin(bench, 2)
    bench.ecu.pieces = 1
    assert bench.ask(0x36, 1, b"ab") is None
    assert bench.ask(0x36, 1, b"ab") == refused(0x36, Nrc.BUSY_REPEAT_REQUEST)
    assert bench.wait(MS) == [b"\x76\x01"]
    assert bench.ask(0x36, 1, b"ab") == b"\x76\x01"
    assert written(bench) == b"ab"
