import pytest

from can_bridge.tester.matching import answers


@pytest.mark.parametrize(
    ("request_", "response", "is_answer"),
    [
        ("3602aa", "7602", True),
        ("3602aa", "7601", False),
        ("3602aa", "7f3673", True),
        ("3602aa", "7f3122", False),
        ("22f191", "62f19141", True),
        ("22f191", "62f18641", False),
        ("3101ff00", "7101ff0000000000", True),
        ("3101ff00", "7101ff0100", False),
        ("2701", "670101", True),
        ("2701", "6702", False),
        ("37", "77", True),
        ("3400440000", "74200ff0", True),
        ("1002", "5002003201f4", True),
        ("1002", "5003003201f4", False),
        ("1101", "5101", True),
        ("37", "", False),
        ("37", "7f", False),
        ("37", "7f37", False),
        ("", "77", False),
        ("3602aa", "76", False),
    ],
)
def test_a_response_is_matched_by_what_it_repeats(request_: str, response: str, is_answer: bool) -> None:
    """By the layout of ISO 14229-1's positive and negative responses."""
    assert answers(bytes.fromhex(request_), bytes.fromhex(response)) is is_answer
