"""Where a value of a component stands: indices, views and padding agree."""

import numpy as np
import pytest

from wake.solver.flow import Flow, Layout
from wake.solver.grid import Component

SHAPE = (5, 4)
UNPADDED: dict[Component, tuple[int, int]] = {"u": (6, 4), "v": (5, 5), "p": (5, 4)}


@pytest.fixture
def flow() -> Flow:
    """Every value is its own place in the buffer."""
    return Flow.of(np.arange(Layout(SHAPE).size, dtype=np.float64), SHAPE)


def test_the_components_fill_the_buffer_in_turn(flow):
    assert np.array_equal(np.concatenate([flow.u.ravel(), flow.v.ravel(), flow.p.ravel()]), flow.flat)
    assert (flow.u.shape, flow.v.shape, flow.p.shape) == ((7, 6), (7, 5), (6, 4))
    assert np.array_equal(flow.velocities, flow.flat[: 7 * 6 + 7 * 5])


@pytest.mark.parametrize("component", ["u", "v", "p"])
def test_an_index_finds_the_value_that_the_view_holds(flow, component):
    padded, layout = getattr(flow, component), Layout(SHAPE)
    view = {"u": flow.faces_u, "v": flow.faces_v, "p": flow.cells_p}[component]
    assert view.shape == UNPADDED[component]
    for (i, j), place in np.ndenumerate(view):
        assert layout.index(component, i, j) == place
        assert padded.ravel()[layout.offset(component, i, j)] == place


def test_the_padding_lies_where_the_stencils_reach(flow):
    """A row of u beyond each side and a column behind the outlet; a column of v at either end; one of p behind the
    outlet."""
    assert flow.u[0, 1] == flow.faces_u[0, 0]
    assert flow.v[1, 0] == flow.faces_v[0, 0]
    assert flow.p[0, 0] == flow.cells_p[0, 0]


def test_views_share_the_buffer():
    flow = Flow.zeros(SHAPE)
    flow.faces_u[2, 3], flow.faces_v[0, 4], flow.cells_p[4, 1] = 1.0, 2.0, 3.0
    layout = Layout(SHAPE)
    found = [flow.flat[layout.index(*place)] for place in (("u", 2, 3), ("v", 0, 4), ("p", 4, 1))]
    assert found == [1.0, 2.0, 3.0]
    assert np.count_nonzero(flow.flat) == 3
