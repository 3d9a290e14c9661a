"""Order of convergence in time, on the developed wake with the jets on the move."""

import numpy as np
import pytest

from wake.truck.truck_wake import TruckWake

STEPS = (30, 60, 120)
"""In a control period; the plant takes 30 on the shipped grid."""


def _after_two_ramps(wake: TruckWake, steps: int) -> tuple[np.ndarray, np.ndarray]:
    """Velocities and pressure after the jets went to 0.06 and on to -0.03, a period each."""
    for start, end in ((0.0, 0.06), (0.06, -0.03)):
        wake.solver.run(wake.flow, dt=0.2 / steps, steps=steps, action_from=start, action_to=end)
    velocities = np.concatenate([wake.flow.u.reshape(-1), wake.flow.v.reshape(-1)])
    return velocities, wake.flow.p.copy()


@pytest.mark.slow  # runs the solver with three time steps
def test_velocity_is_of_second_order_in_time_and_pressure_of_first(coarse):
    results, orders = [], []
    for steps in STEPS:
        with coarse.plant() as wake:
            results.append(_after_two_ramps(wake, steps))
    for quantity in (0, 1):
        few, middle, many = (result[quantity] for result in results)
        orders.append(np.log2(np.linalg.norm(few - middle) / np.linalg.norm(middle - many)))
    # Richardson: successive differences fall as the error does. Measured 1.99 and 1.02; the pressure is that of the
    # last projection, half a step old.
    assert orders[0] == pytest.approx(2.0, abs=0.1)
    assert orders[1] == pytest.approx(1.0, abs=0.1)
    # What the plant's own step leaves: far below the grid's error.
    assert np.abs(results[0][0] - results[2][0]).max() < 5e-3
