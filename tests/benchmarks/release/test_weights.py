"""Two weights of the shipped release, from one end of their range to the other, in the closed loop."""

from pathlib import Path
from statistics import mean

import pytest

from benchmarks.release.weights import DEAREST, Case, outcome, started
from contract.shipped import BUNDLE


@pytest.mark.proofs
def test_a_weight_does_what_it_is_called(tmp_path: Path) -> None:
    # Single starts of one value differ by a factor of two in power.
    folder = started(tmp_path, phases=3)
    for weight, effect, least in (("lift", "abs_Cl_controlled", 1 / 3), ("effort", "jet_power_controlled", 1 / 2)):
        none, dearest = (
            mean(
                outcome(BUNDLE, folder / f"start_{phase}.npz", Case(weight, value, phase))[effect] for phase in range(3)
            )
            for value in (0.0, DEAREST[weight])
        )
        assert dearest < (1.0 - least) * none, weight
