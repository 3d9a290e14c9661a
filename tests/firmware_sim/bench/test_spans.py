"""Spans of a run: what is too short is refused before it starts, with what is needed."""

from math import inf, nan

import pytest

from contract.errors import StillwakeError
from firmware_sim.bench.spans import Spans
from tests.each import each

USUAL = {"lead_in": 25.0, "controlled": 100.0, "settle": 40.0}


@each("name", ["lead_in", "controlled", "settle"])
@each("value", [inf, -inf, nan, -1.0])
@each("averages", [True, False])
def test_a_span_must_be_a_number(name, value, averages):
    with pytest.raises(StillwakeError, match=rf"--{name.replace('_', '-')} = {value}: must be a number of t_c"):
        Spans(**{**USUAL, name: value}, averages=averages)


@each(
    "changes, named",
    [
        ({"lead_in": 9.8}, "--lead-in = 9.8: must be at least 10 t_c, 2 shedding cycles, .*--no-averages"),
        # Before, these two ran to the end and gave nan.
        ({"controlled": 6.0}, "--controlled = 6 less --settle = 40 leaves -34 t_c: must be at least 10 t_c"),
        ({"controlled": 2.0, "settle": 200.0}, "--controlled = 2 less --settle = 200 leaves -198 t_c"),
        ({"controlled": 9.9, "settle": 0.0}, "leaves 9.9 t_c"),
    ],
)
def test_a_run_too_short_for_its_averages_is_refused(changes, named):
    with pytest.raises(StillwakeError, match=named):
        Spans(**{**USUAL, **changes})
    # A quick check asks for none.
    Spans(**{**USUAL, **changes}, averages=False)


@each("name", ["lead_in", "controlled"])
def test_a_span_below_a_control_period_is_refused(name):
    spans = Spans(**{**USUAL, name: 0.05}, averages=False)
    with pytest.raises(StillwakeError, match=rf"--{name.replace('_', '-')} = 0\.05: shorter than a control period of"):
        spans.periods(0.2)
