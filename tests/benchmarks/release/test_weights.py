"""Two weights of the shipped release, from one end of their range to the other, in the closed loop."""

from dataclasses import replace
from pathlib import Path
from statistics import mean

import pytest

from benchmarks.release.weights import DEAREST, outcome, started
from contract.config.loading import load_config
from contract.release import bundle as bundles
from contract.shipped import BUNDLE
from ecu.calibrating import release_calibration
from stillwake.parts.differentiable_wake import mesh_of


@pytest.mark.proofs
@pytest.mark.parametrize(
    ("weight", "effect", "least"), [("lift", "abs_Cl_controlled", 1 / 3), ("effort", "jet_power_controlled", 1 / 2)]
)
def test_a_weight_does_what_it_is_called(weight: str, effect: str, least: float, tmp_path: Path) -> None:
    # Single starts of one value differ by a factor of two in power.
    folder = started(tmp_path, phases=3)
    own = release_calibration(bundles.load(BUNDLE), mesh_of(load_config()))
    none, dearest = (
        mean(
            outcome(
                BUNDLE, folder / f"start_{phase}.npz", replace(own, weights=replace(own.weights, **{weight: value}))
            )[effect]
            for phase in range(3)
        )
        for value in (0.0, DEAREST[weight])
    )
    assert dearest < (1.0 - least) * none
