"""A linear-quadratic regulator on an identified model: the state is its history, so no observer is needed.

Minimised is the sum over k of  z_{k+1}' Q z_{k+1} + R a_k^2  with z = (y, w), what the model predicts one step ahead.
With z_{k+1} = E x_k + F a_k that is a cost with a cross term (Anderson and Moore, Optimal Control, section 3.4).
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
import scipy.linalg

from contract.arrays import Array
from contract.errors import StillwakeError
from train.linear.identification import Arx

REGULARISATION: Final = 1e-9
"""Added to the weights of the state: the oldest entries of a history may have no weight of their own."""


class DesignError(StillwakeError):
    """Weights for which there is no stabilising regulator of the model."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Regulator:
    """The action a_k = gain x_k, without its limit.

    Attributes:
        gain: (L, p + 1) on the history, oldest row first; the last entry, on a_k itself, is 0.
        open_loop: spectral radius of the model without action.
        closed_loop: with it.
    """

    gain: Array
    open_loop: float
    closed_loop: float


def design(model: Arx, weights: Sequence[float], action_weight: float) -> Regulator:
    """Solve the discrete algebraic Riccati equation. Raises DesignError if there is no solution, or the closed loop is
    not stable.

    Args:
        weights: diagonal of Q, (p + q,).
        action_weight: R.
    """
    A, B = model.state_space()
    outputs = model.flat
    by_state, by_action = outputs[:, :-1], outputs[:, -1:]
    Q = np.diag(np.asarray(weights, dtype=np.float64))
    # A weight of 1e308 overflows here; the equation fails below.
    with np.errstate(over="ignore", invalid="ignore"):
        state = by_state.T @ Q @ by_state + REGULARISATION * np.eye(len(A))
        cross = by_state.T @ Q @ by_action
        control = by_action.T @ Q @ by_action + action_weight
    try:
        P = scipy.linalg.solve_discrete_are(A, B, state, control, s=cross)
        K = np.linalg.solve(control + B.T @ P @ B, B.T @ P @ A + cross.T)
        closed = spectral_radius(A - B @ K)
    except (np.linalg.LinAlgError, ValueError) as error:
        raise DesignError(f"no regulator for these weights: the Riccati equation has no solution ({error})") from error
    # Written so that a NaN fails.
    if not closed < 1.0:
        raise DesignError(f"the closed loop's spectral radius is {closed:.4f}: must be below 1; change the weights")
    gain = np.append(-K[0], 0.0).reshape(model.window, model.columns)
    return Regulator(gain=gain, open_loop=spectral_radius(A), closed_loop=closed)


def spectral_radius(matrix: Array) -> float:
    """Largest magnitude of an eigenvalue."""
    return float(np.abs(np.linalg.eigvals(matrix)).max())
