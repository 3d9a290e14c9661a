"""Deviations from MISRA C:2012: those that are found are those that are listed."""

import pytest

from tests.each import each
from tests.proofs.ecu_in_c import misra
from tests.proofs.ecu_in_c.library import sources
from tests.proofs.ecu_in_c.variants import VARIANTS

pytestmark = [
    pytest.mark.compiler,
    pytest.mark.skipif(not misra.is_possible(), reason="cppcheck (extra dev) is not installed"),
]
PLANTED = {
    "15.1": (b"{", b"{ goto end; end:"),
    "7.1": (b"{", b"{ const int octal = 017; (void)octal;"),
    "21.3": (b"{", b"{ extern void *malloc(size_t size); (void)malloc(1u);"),
    "17.2": (b"{", b"{ (void)is_finite(value); return is_finite(value);"),
}
"""Put into the body of `is_finite` of the gate: a jump, an octal number, memory of the heap, recursion."""
_BODY = b"static int is_finite(double value) "


@pytest.fixture(scope="module")
def gate():
    """The gate's own deviations, and its sources."""
    contents = sources(VARIANTS["as shipped"])
    return misra.of(contents, ["sw_gate.c"]), contents


@pytest.mark.slow  # cppcheck takes some ten seconds
def test_each_deviation_is_listed_and_each_listed_one_occurs():
    assert misra.unlisted(misra.found()) == []


@each("rule", ["15.1", "7.1", "21.3", "17.2"])
def test_a_violation_that_is_planted_is_found(gate, rule):
    before, contents = gate
    old, new = PLANTED[rule]
    source = contents["sw_gate.c"]
    assert source.count(_BODY + old) == 1
    after = misra.of(contents | {"sw_gate.c": source.replace(_BODY + old, _BODY + new)}, ["sw_gate.c"])
    assert ("sw_gate.c", rule) in after
    assert ("sw_gate.c", rule) not in before


def test_a_deviation_that_is_not_listed_is_named():
    key = next(iter(misra.listed()))
    deviations = misra.Deviations(dict.fromkeys(misra.listed(), 1))
    assert misra.unlisted(deviations) == []
    assert misra.unlisted(deviations + misra.Deviations({("sw_gate.c", "15.1"): 1})) == [
        "sw_gate.c: rule 15.1 is not listed"
    ]
    del deviations[key]
    assert misra.unlisted(deviations) == [f"{key[0]}: rule {key[1]} is listed and does not occur"]
