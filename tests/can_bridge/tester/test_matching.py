from can_bridge.tester.transport import answers

CASES = """
3602aa 7602 yes
3602aa 7601 no
3602aa 7f3673 yes
3602aa 7f3122 no
22f191 62f19141 yes
22f191 62f18641 no
3101ff00 7101ff0000000000 yes
3101ff00 7101ff0100 no
2701 670101 yes
2701 6702 no
37 77 yes
190209 59027f yes
1904d1018701 5904d101872f yes
1904d1018701 59041106862f no
1906d10187ff 5904d101872f no
8502 c502 yes
3400440000 74200ff0 yes
1002 5002003201f4 yes
1002 5003003201f4 no
1101 5101 yes
37 7f no
37 7f37 no
3602aa 76 no
"""


def test_a_response_is_matched_by_what_it_repeats():
    """By the layout of ISO 14229-1's positive and negative responses."""
    for case in CASES.split("\n")[1:-1]:
        request, response, is_answer = case.split()
        assert answers(bytes.fromhex(request), bytes.fromhex(response)) is (is_answer == "yes"), case
    assert not answers(b"\x37", b"") and not answers(b"", b"\x77")
