"""Downloads block by block, through the server; `tests/can_bridge/tester` loses and doubles requests."""

import pytest

from can_bridge.uds.services import MAX_BLOCK, Nrc
from tests.can_bridge.uds.scripted_ecu import MS, Bench, S, refused


@pytest.fixture
def bench() -> Bench:
    bench = Bench()
    bench.unlock()
    return bench


def asking(length: int, offset: int = 0) -> str:
    return f"34 00 44 {offset:08x} {length:08x}"


def written(bench: Bench) -> bytes:
    return b"".join(call[1] for call in bench.ecu.calls if call[0] == "transfer")


def test_download_requests(bench):
    bench.talk(
        f"""
        34 10 44 00x8 > OUT_OF_RANGE
        34 01 44 00x8 > OUT_OF_RANGE
        34 00 33 00x8 > OUT_OF_RANGE
        34 00 24 00x8 > OUT_OF_RANGE
        34 00 44 00x7 > INCORRECT_LENGTH
        34 00 44 00x9 > INCORRECT_LENGTH
        {asking(10, offset=7)} > 74 20 {MAX_BLOCK:04x}
        {asking(5)} > CONDITIONS_NOT_CORRECT
        36 01 00x4 > 76 01
        {asking(10, offset=7)} > CONDITIONS_NOT_CORRECT
        10 02 > ok
        {asking(0)} > SECURITY_ACCESS_DENIED
        36 01 00 > SECURITY_ACCESS_DENIED
        37 > SECURITY_ACCESS_DENIED
        """
    )
    assert [call for call in bench.ecu.calls if call[0] == "download"] == [("download", 7, 10)]


def test_blocks_out_of_order_and_of_another_length(bench):
    bench.talk(
        f"""
        36 01 AA > SEQUENCE_ERROR
        37 > SEQUENCE_ERROR
        {asking(4)} > ok
        {asking(4)} > ok
        36 00 AA > WRONG_BLOCK_COUNTER
        36 01 00x5 > TRANSFER_SUSPENDED
        36 01 AA BB > 76 01
        36 01 AA BB > 76 01
        36 00 CC > WRONG_BLOCK_COUNTER
        36 01 CC > WRONG_BLOCK_COUNTER
        36 03 CC > WRONG_BLOCK_COUNTER
        36 FF CC > WRONG_BLOCK_COUNTER
        37 > SEQUENCE_ERROR
        36 02 CC DD > 76 02
        36 02 CC DD > 76 02
        36 03 EE > SEQUENCE_ERROR
        37 > 77
        37 > 77
        36 02 CC DD > SEQUENCE_ERROR
        {asking(MAX_BLOCK)} > ok
        36 01 00x{MAX_BLOCK - 1} > INCORRECT_LENGTH
        36 01 00x{MAX_BLOCK - 2} > 76 01
        """
    )
    assert written(bench)[: -MAX_BLOCK + 2] == b"\xaa\xbb\xcc\xdd", "a block that is sent again is written once"


def test_what_ends_a_download(bench):
    bench.talk(f"{asking(4)} > ok\n36 01 AA > ok\n31 01 FF 00 00x36 > ok\n36 02 BB > SEQUENCE_ERROR\n{asking(5)} > ok")
    bench.wait(5 * S)
    bench.unlock()
    bench.talk("36 01 AA > SEQUENCE_ERROR")
    bench.ecu.refusals = {"download": Nrc.OUT_OF_RANGE, "transfer": Nrc.PROGRAMMING_FAILURE}
    bench.talk(f"{asking(4)} > OUT_OF_RANGE\n36 01 AA > SEQUENCE_ERROR")
    del bench.ecu.refusals["download"]
    bench.talk(f"{asking(4)} > ok\n36 01 AA > PROGRAMMING_FAILURE")
    bench.ecu.refusals.clear()
    bench.talk("36 01 AA > SEQUENCE_ERROR")


def test_slow_block_is_repeated_while_it_is_written(bench):
    bench.talk(f"{asking(2)} > ok")
    bench.ecu.pieces = 1
    bench.talk("36 01 AA BB > -")
    assert bench.ask(0x36, 1, b"\xaa\xbb") == refused(0x36, Nrc.BUSY_REPEAT_REQUEST)
    assert bench.wait(MS) == [b"\x76\x01"]
    bench.talk("36 01 AA BB > 76 01")
    assert written(bench) == b"\xaa\xbb"
