"""What is identified, beside systems whose coefficients and poles are known."""

import numpy as np
import pytest

from tests.train.linear.systems import KNOWN, LAYOUT, NAMES, PERIOD, episode, growing
from train.linear.differences import Series, series_of
from train.linear.identification import Arx, IdentificationError, fit, growing_modes, refuse_spurious, roll_out_r2


def series(steps: int = 400, seed: int = 0, *, noise: float = 0.0) -> Series:
    return series_of(episode("one", steps, seed, noise=noise), LAYOUT, NAMES, ("Cl",), 0)


def test_the_coefficients_of_a_known_system_are_found():
    """In two stretches, of which neither is fitted across its end."""
    found = fit([series(300, 0), series(200, 1)], 2, 1e-13)
    np.testing.assert_allclose(found.coefficients, KNOWN, atol=1e-6)
    # A memory that is too long finds the same predictions.
    longer = fit([series(600)], 5, 1e-13)
    np.testing.assert_allclose(roll_out_r2(longer, [series(400, 2)]), 1.0, atol=1e-5)
    # Ljung, section 4.2: the error of the action's coefficients falls with the number of steps.
    noisy = (fit([series(steps, 3, noise=0.01)], 2, 1e-12) for steps in (300, 10_000))
    few, many = (np.abs(found.coefficients[:2] - KNOWN[:2]).max() for found in noisy)
    assert many < min(0.03, few / 2)
    # Rows of sqrt(ridge m) times the scale under the regressors give the same least squares.
    one, window, ridge = series(200, 4, noise=0.02), 3, 1e-2
    X = np.array([one.rows[k - window + 1 : k + 1].ravel() for k in range(window - 1, len(one) - 1)])
    T = np.column_stack([one.rows[window:, :2], one.responses[window:]])
    scale = np.sqrt((X**2).mean(axis=0))
    padded = np.vstack([X, np.diag(np.sqrt(ridge * len(X)) * scale)])
    expected = np.linalg.lstsq(padded, np.vstack([T, np.zeros((X.shape[1], 3))]), rcond=None)[0]
    np.testing.assert_allclose(fit([one], window, ridge).flat, expected.T, rtol=1e-7, atol=1e-9)


def test_roll_outs_are_judged_on_recorded_actions():
    """The true system predicts any number of steps; one with the action's share turned round does not."""
    true = Arx(coefficients=KNOWN, differences=2)
    np.testing.assert_allclose(roll_out_r2(true, [series()]), 1.0, atol=1e-12)
    wrong = KNOWN.copy()
    wrong[:, :, 2] *= -1.0
    assert (roll_out_r2(Arx(coefficients=wrong, differences=2), [series()])[1:, :2] < 0.5).all()
    with pytest.raises(IdentificationError, match=r"stretches of 40 steps: .*need 52"):
        roll_out_r2(true, [series(40)])
    one = series()
    still = Series(rows=one.rows * [1.0, 1.0, 0.0], responses=one.responses)
    with pytest.raises(IdentificationError, match="the action is zero throughout"):
        fit([still], 2, 1e-3)
    # Growing modes are those that were planted.
    for radius, angle in ((1.02, 0.25), (1.2, 2.8)):
        (mode,) = growing_modes(Arx(coefficients=growing(radius, angle), differences=1), PERIOD)
        assert mode.growth == pytest.approx(np.log(radius) / PERIOD)
        assert mode.frequency == pytest.approx(angle / (2 * np.pi * PERIOD))
        if mode.growth > 0.5:
            with pytest.raises(IdentificationError, match=r"grows by 0\.912 .* larger ridge"):
                refuse_spurious((mode,), 0.5)
        else:
            refuse_spurious((mode,), 0.5)
    assert growing_modes(Arx(coefficients=growing(0.98, 0.3), differences=1), PERIOD) == ()
