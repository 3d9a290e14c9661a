"""Bodies and their sensors: the rules of the settings, and places on the surface."""

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from contract import sensors
from contract.config.body import BodyConfig
from contract.config.body_sensors import layout_of
from contract.errors import ConfigError
from contract.geometry import HALF_WIDTH, JET_WIDTH


def test_the_defaults_are_the_papers_truck_and_the_rule_gives_its_table():
    assert layout_of(BodyConfig()) is sensors.TRUCK
    # With another length the rule decides. The paper's table has 0.204555 once, for 0.204545.
    near = layout_of(BodyConfig(length=7.648))
    assert near.names == sensors.NAMES
    assert np.abs(near.positions[80:, 1] - sensors.positions()[80:, 1]).max() == pytest.approx(1e-5, rel=1e-6)
    assert np.abs(near.positions[:80] - sensors.positions()[:80]).max() < 1.1e-3


@given(length=st.floats(0.5, 15.0), radius=st.floats(1e-9, 0.5), sides=st.integers(1, 120), on_base=st.integers(1, 20))
def test_sensors_lie_on_sides_and_base_clear_of_edge_and_slots(length, radius, sides, on_base):
    assume(radius <= 0.5 * length)
    body = BodyConfig(length=length, leading_edge_radius=radius, sensors_per_side=sides, sensors_on_base=on_base)
    layout = layout_of(body)
    assert len(layout) == 2 * sides + on_base
    x, y = layout.positions.T
    base = np.zeros(len(layout), dtype=bool)
    base[layout.base] = True
    assert (x[base] == length).all() and (np.abs(y[base]) < HALF_WIDTH - JET_WIDTH).all()
    assert (np.abs(y[~base]) == HALF_WIDTH).all()
    assert ((x[~base] > radius - 1e-6) & (x[~base] < length + 1e-6)).all()
    # Front to rear, top to bottom, and each its own mirror image.
    assert (np.diff(x[:sides]) >= 0).all() and (np.diff(y[base]) < 0).all()
    assert layout.mirror is not None
    assert np.array_equal(layout.positions[layout.mirror], layout.positions * (1.0, -1.0))
    assert layout.names[layout.mirror[layout.names.index("upper_00")]] == "lower_00"


def test_a_body_that_does_not_hold_its_nose_is_refused():
    with pytest.raises(ConfigError, match=r"leading_edge_radius = 0\.4: must be at most half the length"):
        BodyConfig(length=0.6, leading_edge_radius=0.4)
