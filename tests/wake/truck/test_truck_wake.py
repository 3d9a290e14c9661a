"""The plant: ramps, copies and threads, what it refuses, and other bodies in the same solver."""

import copy
import pickle
import re
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from threadpoolctl import threadpool_info, threadpool_limits

from contract.config.body import BodyConfig
from contract.config.operating_point import OperatingPoint
from contract.config.plant import FlowConfig
from contract.errors import PlantError
from wake.plant.drive import Drive
from wake.solver import poisson
from wake.truck.state import Origin, developed_state, load_state, save_state
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


def test_a_copy_or_a_restart_within_a_period_is_a_plant_of_its_own(coarse, tmp_path):
    """It goes on to the bit, in the wind of a drive, and no compiled function takes it for one of another kind."""
    with coarse.plant() as wake:
        wake.wind = Drive(name="faster", times=(0.0, 0.1), speeds=(25.0, 30.0)).wind(OperatingPoint(), wake.t)
        wake.advance_to(5, 0.05)
        stood = wake.flow.flat.copy()
        solve_half: Any = poisson._solve_half
        compiled = len(solve_half.signatures)
        save_state(tmp_path / "state.npz", wake.state())
        restarted = TruckWake(coarse.flow)
        restarted.reset(load_state(tmp_path / "state.npz"))
        restarted.wind = wake.wind
        copies = [copy.copy(wake), copy.deepcopy(wake), pickle.loads(pickle.dumps(wake)), restarted]
        for one in copies:
            assert (one.substeps_into_period, one.action) == (5, wake.action)
            one.advance(-0.03)
            one.advance(0.01)
        np.testing.assert_array_equal(wake.flow.flat, stood)
        wake.advance(-0.03)
        sample = wake.advance(0.01)
        for one in copies:
            np.testing.assert_array_equal(one.flow.flat, wake.flow.flat)
            np.testing.assert_array_equal(one.sample().Cp, sample.Cp)
        assert len(solve_half.signatures) == compiled


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


@pytest.mark.slow
def test_divergence_names_the_step_its_number_and_a_step_that_holds(wake):
    before = wake.flow.flat.copy()
    with pytest.raises(PlantError, match=r"diverged .* dt = 0\.05: convective number") as caught:
        wake.solver.run(wake.flow, dt=0.05, steps=40, action_from=0.0, action_to=0.0)
    number, advised = map(float, re.findall(r"convective number ([\d.]+) .* take dt = ([\d.]+)", str(caught.value))[0])
    # A free stream of 1.05 past cells of 0.0125 by 0.0125 at the front corners.
    assert number == pytest.approx(0.05 * 2 * 1.05 / 0.0125, rel=0.2)
    assert np.array_equal(wake.flow.flat, before)
    wake.solver.run(wake.flow, dt=advised, steps=round(1.0 / advised), action_from=0.0, action_to=0.0)


@pytest.mark.slow  # builds flows
def test_a_step_too_long_is_refused_with_one_that_is_not(coarse):
    for changes, named in (
        ({"action_limit": 0.2}, "convective number of the jets"),
        ({"reynolds": 20.0}, "viscous number"),
        ({"control_period": 1.0}, "convective number of the free stream"),
    ):
        config = replace(coarse.flow, **changes)
        with pytest.raises(PlantError, match=named) as caught:
            TruckWake(config)
        (substeps,) = re.findall(r"at least (\d+) substeps", str(caught.value))
        TruckWake(replace(config, substeps=int(substeps)))


def test_a_state_that_does_not_fit_is_refused_and_changes_nothing(wake):
    (nx, ny), state, before = wake.grid.shape, developed_state(), wake.flow.flat.copy()
    broken = state.flat.copy()
    broken[5] = np.nan
    own = Origin(shape=(nx, ny), reynolds=500.0)
    other_clock = replace(own, control_period=0.2, substeps=60)
    cases: list[tuple[dict[str, Any], str]] = [
        # The same number of cells; a transposed buffer would even have the right size for a square.
        ({"origin": Origin(shape=(ny, nx), reynolds=500.0)}, f"{ny} x {nx} cells, this grid needs {nx} x {ny}"),
        ({"flat": broken}, "not finite"),
        ({"origin": replace(own, body_length=1.0)}, "for a body of length 1 and .* has 7.647"),
        ({"origin": replace(own, reynolds=400.0)}, "reynolds = 400, this plant has 500"),
        ({"origin": other_clock, "substep": 45}, r"60 substeps in 0\.2 t_c, this plant has 30 in 0\.2"),
        ({"action": 0.08}, "action 0.08: must be within"),
    ]
    for changes, message in cases:
        with pytest.raises(PlantError, match=message):
            wake.reset(replace(state, **changes))
        assert np.array_equal(wake.flow.flat, before), message
    # A start at t = 0 may be continued with another step.
    assert wake.reset(replace(state, origin=other_clock, substep=0)).t == 0.0
    for action in (float("nan"), 0.0751):
        with pytest.raises(PlantError, match="within"):
            wake.advance(action)


def test_what_is_no_state_file_is_one_clear_error(wake, tmp_path):
    path = tmp_path / "state.npz"
    with pytest.raises(PlantError, match="without its origin cannot be written"):
        save_state(path, replace(wake.state(), origin=None))
    path.write_bytes(b"PK\x03\x04 nonsense")
    for wrong in (path, tmp_path / "none.npz"):
        with pytest.raises(PlantError, match="not a flow state"):
            load_state(wrong)
    for origin in (Origin(shape=(2, 3), reynolds=9.0, body_length=2.0), wake.state().origin):
        save_state(path, replace(wake.state(), origin=origin))
        assert load_state(path).origin == origin
    with np.load(path) as data:
        content = {key: data[key] for key in data.files}
    np.savez(path, **(content | {"schema": "stillwake-flow/1"}))
    with pytest.raises(PlantError, match=r"schema stillwake-flow/1, but this version reads 'stillwake-flow/2'"):
        load_state(path)


SQUARE = BodyConfig(length=1.0, leading_edge_radius=0.0, sensors_per_side=6, sensors_on_base=4)


def test_the_trucks_first_steps_are_those_from_before_other_bodies(wake):
    for action in (0.02, 0.07, -0.05):
        sample = wake.advance(action)
    # The last bit depends on the processor's linear algebra.
    assert sample.Cd == pytest.approx(0.9973759647024201, rel=1e-12)
    assert sample.Cl == pytest.approx(2.106641897948373, rel=1e-12)
    assert sample.Uy_probe == pytest.approx(-0.5623716000360626, rel=1e-12)


def test_a_symmetric_flow_stays_symmetric_but_for_rounding():
    square = TruckWake(FlowConfig(reynolds=100.0, substeps=12, refinement=0.4), body=SQUARE)
    square.flow.flat[:] = square.solver.start().flat
    square.solver.run(square.flow, dt=1e-3, steps=50, action_from=0.0, action_to=0.0)
    sample = square.advance(0.0)
    u, v, p = square.flow.u, square.flow.v, square.flow.p
    assert np.abs(u - u[:, ::-1]).max() < 1e-12
    assert np.abs(v + v[:, ::-1]).max() < 1e-12
    assert np.abs(p - p[:, ::-1]).max() < 1e-11
    assert square.layout.mirror is not None
    assert sample.Cp == pytest.approx(sample.Cp[square.layout.mirror], abs=1e-12)
    assert sample.Cl == pytest.approx(0.0, abs=1e-12)
