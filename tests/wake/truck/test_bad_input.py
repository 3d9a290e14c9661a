"""What the plant is given wrongly is refused by name, and nothing is changed by it."""

import dataclasses
import re
from typing import Any

import numpy as np
import pytest

from contract.errors import PlantError
from wake.truck.state import Origin, developed_state, load_state, save_state
from wake.truck.truck_wake import TruckWake


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
        config = dataclasses.replace(coarse.flow, **changes)
        with pytest.raises(PlantError, match=named) as caught:
            TruckWake(config)
        (substeps,) = re.findall(r"at least (\d+) substeps", str(caught.value))
        TruckWake(dataclasses.replace(config, substeps=int(substeps)))


def test_a_state_that_does_not_fit_is_refused_and_changes_nothing(wake):
    (nx, ny), state, before = wake.grid.shape, developed_state(), wake.flow.flat.copy()
    broken = state.flat.copy()
    broken[5] = np.nan
    other_clock = Origin(shape=(nx, ny), reynolds=500.0, control_period=0.2, substeps=60)
    cases: list[tuple[dict[str, Any], str]] = [
        # The same number of cells; a transposed buffer would even have the right size for a square.
        ({"origin": Origin(shape=(ny, nx), reynolds=500.0)}, f"{ny} x {nx} cells, this grid needs {nx} x {ny}"),
        ({"flat": broken}, "not finite"),
        ({"origin": Origin(shape=(nx, ny), reynolds=400.0)}, "reynolds = 400, this plant has 500"),
        ({"origin": other_clock, "substep": 45}, r"60 substeps in 0\.2 t_c, this plant has 30 in 0\.2"),
        ({"action": 0.08}, "action 0.08: must be within"),
    ]
    for changes, message in cases:
        with pytest.raises(PlantError, match=message):
            wake.reset(dataclasses.replace(state, **changes))
        assert np.array_equal(wake.flow.flat, before), message
    # A start at t = 0 may be continued with another step.
    assert wake.reset(dataclasses.replace(state, origin=other_clock, substep=0)).t == 0.0
    for action in (float("nan"), 0.0751):
        with pytest.raises(PlantError, match="within"):
            wake.advance(action)


def test_what_is_no_state_file_is_one_clear_error(wake, tmp_path):
    path = tmp_path / "state.npz"
    with pytest.raises(PlantError, match="without its origin cannot be written"):
        save_state(path, dataclasses.replace(wake.state(), origin=None))
    path.write_bytes(b"PK\x03\x04 nonsense")
    for wrong in (path, tmp_path / "none.npz"):
        with pytest.raises(PlantError, match="not a flow state"):
            load_state(wrong)
    save_state(path, wake.state())
    with np.load(path) as data:
        content = {key: data[key] for key in data.files}
    np.savez(path, **(content | {"schema": "stillwake-flow/1"}))
    with pytest.raises(PlantError, match=r"schema stillwake-flow/1, this version reads 'stillwake-flow/2'"):
        load_state(path)
