"""Two weights of the shipped release, from one end of their range to the other, in the closed loop."""

from pathlib import Path
from statistics import mean

import pytest

from benchmarks.release.weights import DEAREST, PHASES, Case, outcome, started


@pytest.mark.proofs
def test_a_weight_does_what_it_is_called(tmp_path: Path) -> None:
    # Single starts of one value differ by a factor of two in power.
    folder = started(tmp_path)
    for weight, effect, least in (("lift", "abs_Cl_controlled", 1 / 3), ("effort", "jet_power_controlled", 1 / 2)):
        none, dearest = (
            mean(outcome(folder / f"start_{n}.npz", Case(weight, value, n))[effect] for n in range(PHASES))
            for value in (0.0, DEAREST[weight])
        )
        assert dearest < (1.0 - least) * none, weight
