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
