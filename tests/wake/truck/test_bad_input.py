"""What the plant is given wrongly is refused by name, and nothing is changed by it."""

import dataclasses
import re

import numpy as np
import pytest

from contract.config.plant import FlowConfig
from contract.errors import PlantError
from wake.truck.state import Origin, State, developed_state, load_state, save_state
from wake.truck.truck_wake import TruckWake


def _state(origin: Origin, substep: int = 0) -> State:
    return dataclasses.replace(developed_state(), origin=origin, substep=substep)


def test_divergence_names_the_step_its_number_and_a_step_that_holds(wake):
    before = wake.flow.flat.copy()
    with pytest.raises(PlantError, match=r"diverged .* dt = 0\.05: convective number") as caught:
        wake.solver.run(wake.flow, dt=0.05, steps=40, action_from=0.0, action_to=0.0)
    number, advised = map(float, re.findall(r"convective number ([\d.]+) .* take dt = ([\d.]+)", str(caught.value))[0])
    # A free stream of 1.05 past cells of 0.0125 by 0.0125 at the front corners.
    assert number == pytest.approx(0.05 * 2 * 1.05 / 0.0125, rel=0.2)
    assert np.array_equal(wake.flow.flat, before)
    wake.solver.run(wake.flow, dt=advised, steps=round(2.0 / advised), action_from=0.0, action_to=0.0)


def test_what_is_refused_at_construction_does_diverge(wake):
    with pytest.raises(PlantError, match=r"convective number of the free stream .* at least \d+ substeps"):
        TruckWake(FlowConfig(substeps=12))
    with pytest.raises(PlantError, match="diverged"):
        for _ in range(10):
            wake.solver.run(wake.flow, dt=0.2 / 12, steps=12, action_from=0.0, action_to=0.0)


@pytest.mark.slow  # builds flows
def test_a_step_too_long_is_refused_with_one_that_is_not():
    for config, named in [
        (FlowConfig(action_limit=0.2), "convective number of the jets"),
        (FlowConfig(reynolds=20.0), "viscous number"),
        (FlowConfig(control_period=1.0), "convective number of the free stream"),
    ]:
        with pytest.raises(PlantError, match=named) as caught:
            TruckWake(config)
        (substeps,) = re.findall(r"at least (\d+) substeps", str(caught.value))
        TruckWake(dataclasses.replace(config, substeps=int(substeps)))


def test_a_state_of_another_mesh_is_refused(wake, tmp_path):
    nx, ny = wake.grid.shape
    # The same number of cells; a transposed buffer would even have the right size for a square.
    with pytest.raises(PlantError, match=f"{ny} x {nx} cells, this grid needs {nx} x {ny}"):
        wake.reset(_state(Origin(shape=(ny, nx), reynolds=500.0)))
    coarse = TruckWake(FlowConfig(refinement=0.5))
    save_state(tmp_path / "coarse.npz", coarse.state())
    before = wake.flow.flat.copy()
    with pytest.raises(PlantError, match="cells, this grid needs"):
        wake.reset(load_state(tmp_path / "coarse.npz"))
    assert np.array_equal(wake.flow.flat, before)


def test_a_state_of_another_reynolds_number_is_refused(wake):
    with pytest.raises(PlantError, match="reynolds = 400, this plant has 500"):
        wake.reset(_state(Origin(shape=wake.grid.shape, reynolds=400.0)))


def test_a_state_amid_another_clock_is_refused(wake):
    other = Origin(shape=wake.grid.shape, reynolds=500.0, control_period=0.2, substeps=60)
    with pytest.raises(PlantError, match=r"60 substeps in 0\.2 t_c, this plant has 30 in 0\.2"):
        wake.reset(_state(other, substep=45))
    # A start at t = 0 may be continued with another step.
    assert wake.reset(_state(other)).t == 0.0


def test_a_state_whose_jets_exceed_the_bound_is_refused(wake):
    for action in [0.08, float("nan")]:
        with pytest.raises(PlantError, match=f"action {action}: must be within"):
            wake.reset(dataclasses.replace(developed_state(), action=action))


def test_a_state_of_another_schema_is_refused(wake, tmp_path):
    path = tmp_path / "state.npz"
    save_state(path, wake.state())
    with np.load(path) as data:
        content = {key: data[key] for key in data.files}
    np.savez(path, **(content | {"schema": "stillwake-flow/1"}))
    with pytest.raises(PlantError, match=r"schema stillwake-flow/1, this version reads 'stillwake-flow/2'"):
        load_state(path)
    np.savez(path, **(content | {"shape": np.arange(3)}))
    with pytest.raises(PlantError, match="not a flow state"):
        load_state(path)


def test_a_state_without_origin_is_not_written(wake, tmp_path):
    with pytest.raises(PlantError, match="without its origin cannot be written"):
        save_state(tmp_path / "state.npz", dataclasses.replace(wake.state(), origin=None))
    assert not any(tmp_path.iterdir())
