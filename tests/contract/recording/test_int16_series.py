import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st
from hypothesis.extra.numpy import array_shapes, arrays

from contract.recording.dataset import pack, unpack

FINEST, COARSEST = 2.0**-15, 2.0**-8
LIMIT = 32767 * COARSEST


@given(
    values=arrays(np.float64, array_shapes(max_dims=2, max_side=20), elements=st.floats(-LIMIT, LIMIT)),
    shrink=st.floats(1e-6, 1.0),
)
@example(values=np.array([32767.5 * FINEST, -32767.5 * FINEST]), shrink=1.0)
@example(values=np.array([32767.49 * FINEST]), shrink=1.0)
@example(values=np.zeros((0, 3)), shrink=1.0)
def test_every_value_comes_back_within_half_a_quantum(values, shrink):
    values = values * shrink
    integers, quantum = pack(values, FINEST, COARSEST)
    assert integers.dtype == np.int16 and integers.shape == values.shape
    assert (np.abs(unpack(integers, quantum) - values) <= quantum / 2).all()
    # The quantum is the finest that holds the series.
    peak = np.abs(values).max(initial=0.0)
    assert quantum == FINEST or peak > 32767 * quantum / 2
    again, same = pack(unpack(integers, quantum), FINEST, COARSEST)
    assert same == quantum and (again == integers).all()


@given(
    values=arrays(np.float64, st.integers(1, 10), elements=st.floats(-1e9, 1e9)),
    place=st.integers(0, 9),
    beyond=st.floats(LIMIT + COARSEST, 1e12),
    sign=st.sampled_from((1, -1)),
)
def test_what_does_not_fit_is_refused_rather_than_wrapped(values, place, beyond, sign):
    values[place % len(values)] = sign * beyond
    with pytest.raises(ValueError, match=r"more than 127\.996 in magnitude"):
        pack(values, FINEST, COARSEST)
