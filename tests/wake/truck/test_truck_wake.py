import copy
import pickle
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
from threadpoolctl import threadpool_info, threadpool_limits

from contract.config.operating_point import OperatingPoint
from wake.plant.drive import Drive
from wake.solver import poisson
from wake.truck.state import developed_state
from wake.truck.truck_wake import TruckWake


def test_a_command_at_once_is_a_full_period_and_a_late_one_leaves_the_jets_alone_until_it_comes(wake):
    whole = wake.advance(0.03)
    wake.reset(developed_state())
    wake.advance_to(1, 0.03)
    wake.advance_to(wake.config.substeps, 0.03)
    split = wake.sample()
    # The ramp is the same line; its points differ by rounding.
    assert split.Cl == pytest.approx(whole.Cl, abs=1e-10)
    assert split.action == whole.action == 0.03
    wake.advance_to(20)
    assert wake.sample().action == 0.03
    wake.advance_to(wake.config.substeps, -0.05)
    assert wake.sample().action == -0.05


def test_a_copy_within_a_period_is_a_plant_of_its_own(coarse):
    """It goes on to the bit, in the wind of a drive, and no compiled function takes it for one of another kind."""
    with coarse.plant() as wake:
        wake.wind = Drive(name="faster", times=(0.0, 0.1), speeds=(25.0, 30.0)).wind(OperatingPoint(), wake.t)
        wake.advance_to(5, 0.05)
        stood = wake.flow.flat.copy()
        compiled = len(poisson._solve_half.signatures)
        copies = [copy.copy(wake), copy.deepcopy(wake), pickle.loads(pickle.dumps(wake))]
        for one in copies:
            one.advance(-0.03)
            one.advance(0.01)
        np.testing.assert_array_equal(wake.flow.flat, stood)
        wake.advance(-0.03)
        sample = wake.advance(0.01)
        for one in copies:
            np.testing.assert_array_equal(one.flow.flat, wake.flow.flat)
            np.testing.assert_array_equal(one.sample().Cp, sample.Cp)
        assert len(poisson._solve_half.signatures) == compiled


def test_the_number_of_threads_changes_no_bit_and_is_left_alone(coarse):
    """Of BLAS, while the plant is made and while it runs; and of plants at once."""

    def ended_at(action: float) -> bytes:
        wake = TruckWake(coarse.flow)
        wake.reset(coarse.start)
        wake.advance(action)
        return wake.flow.flat.tobytes()

    found = []
    for threads in (1, 2):
        with threadpool_limits(threads):
            found.append(ended_at(0.03))
            assert {library["num_threads"] for library in threadpool_info()} <= {threads}
    before = threadpool_info()
    with ThreadPoolExecutor(2) as pool:
        found += pool.map(ended_at, [0.03] * 2)
    assert threadpool_info() == before
    assert len(set(found)) == 1
