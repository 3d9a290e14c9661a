from hypothesis import given
from hypothesis import strategies as st

from can_bridge.tester.transfer import BLOCK_STEP, BlockLength
from can_bridge.uds.services import MAX_BLOCK
from tests.examples import examples


@given(
    limit=st.integers(0, 10_000),
    fates=st.lists(st.booleans(), max_size=200),
    offsets=st.lists(st.integers(0, 10**6), min_size=1, max_size=5),
)
@examples(100)
def test_blocks_fit_a_request_and_end_at_words(limit: int, fates: list[bool], offsets: list[int]) -> None:
    length = BlockLength()
    length.allow(limit)
    for fate in fates:
        (length.arrived if fate else length.lost)()
    for offset in offsets:
        bytes_ = length.next_from(offset)
        assert 1 <= bytes_ <= max(BLOCK_STEP, limit - 2)
        assert bytes_ <= MAX_BLOCK - 2
        assert (offset + bytes_) % BLOCK_STEP == 0


def test_they_shrink_to_a_word_and_grow_back() -> None:
    length = BlockLength()
    longest = length.next_from(0)
    for _ in range(10):
        length.lost()
    assert length.next_from(0) == BLOCK_STEP
    for _ in range(1000):
        length.arrived()
    assert length.next_from(0) == longest
