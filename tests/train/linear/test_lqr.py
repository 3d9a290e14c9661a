"""The regulator, beside analytic solutions and the regulator of a system with its delay written out."""

import numpy as np
import pytest
import scipy.linalg

from tests.train.linear.systems import KNOWN, growing
from train.linear.identification import Arx
from train.linear.lqr import DesignError, design


def scalar(a: float, b: float) -> Arx:
    """y_{k+1} = a y_k + b u_k, with a memory of one row."""
    return Arx(coefficients=np.array([[[a, b]]]), differences=1)


@pytest.mark.parametrize(("a", "b", "q", "r"), [(1.1, 0.5, 2.0, 1.0), (0.7, 1.0, 1.0, 10.0), (1.5, -2.0, 3.0, 0.1)])
def test_a_scalar_system_has_the_analytic_gain(a, b, q, r):
    """P of a' = q y^2 + r u^2 summed from the next step on: P = s - q with the root s of the scalar Riccati equation
    s = q + a^2 s - (a b s)^2 / (r + b^2 s), and K = a b s / (r + b^2 s)."""
    # b^2 s^2 + (r - a^2 r - b^2 q) s - q r = 0.
    linear = r - a**2 * r - b**2 * q
    s = (-linear + np.sqrt(linear**2 + 4 * b**2 * q * r)) / (2 * b**2)
    found = design(scalar(a, b), [q], r)
    K = a * b * s / (r + b**2 * s)
    assert found.gain[0, 0] == pytest.approx(-K, rel=1e-6)
    assert found.gain[-1, -1] == 0.0
    assert found.open_loop == pytest.approx(a)
    assert found.closed_loop == pytest.approx(abs(a - b * K), rel=1e-6)


def test_cheap_action_stabilises_and_dear_action_reflects_the_pole():
    """With R -> infinity the growing pole p goes to 1 / p (Anderson and Moore, section 6.4)."""
    model = Arx(coefficients=growing(1.1, 0.4), differences=1)
    dear = design(model, [1e-6], 1e3)
    assert dear.closed_loop == pytest.approx(1 / 1.1, rel=1e-3)
    assert design(model, [1.0], 1e-6).closed_loop < dear.closed_loop
    # What cannot be stabilised is refused.
    with pytest.raises(DesignError, match=r"Riccati|spectral radius"):
        design(scalar(1.2, 0.0), [1.0], 1.0)


def test_feedback_at_the_predicted_state_is_the_regulator_with_delay():
    """With one action committed, the state of the system with delay is (x_k, a_k), and a_{k+1} is decided: its own
    Riccati equation gives the gain on what x_{k+1} = A x_k + B a_k will be."""
    model, weights, price = Arx(coefficients=KNOWN, differences=2), np.array([2.0, 3.0, 0.5]), 4.0
    gain = design(model, weights.tolist(), price).gain.ravel()[:-1]
    A, B = model.state_space()
    n = len(A)
    delayed_A = np.block([[A, B], [np.zeros((1, n + 1))]])
    delayed_B = np.vstack([np.zeros((n, 1)), [[1.0]]])
    by_state = model.flat
    Q = by_state.T @ np.diag(weights) @ by_state
    Q[-1, -1] += price
    # The committed action's own cost is sunk, so the price of the next one is the next step's.
    P = scipy.linalg.solve_discrete_are(delayed_A, delayed_B, Q + 1e-9 * np.eye(n + 1), [[1e-9]])
    K = np.linalg.solve(1e-9 + delayed_B.T @ P @ delayed_B, delayed_B.T @ P @ delayed_A)[0]
    np.testing.assert_allclose(-K, gain @ np.hstack([A, B]), rtol=1e-4, atol=1e-5)
