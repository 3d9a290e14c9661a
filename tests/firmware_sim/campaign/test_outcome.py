"""Figures of a run, and the file that keeps them."""

import numpy as np
import pytest

from firmware_sim.campaign.outcome import KeptCourse, MeanFigures, RunOutcome, load, save
from tests.firmware_sim.campaign.conftest import phase_of


def test_means_are_over_the_instants_from_the_end_of_settling_on() -> None:
    n = np.arange(5.0)
    series = {"t": 0.2 * n, "Cd": 0.1 * n, "Cl": np.array([9.0, 9.0, -0.3, 0.1, 0.5]), "action": 0.0 * n - 0.02}
    figures = MeanFigures.over(KeptCourse.of(series, 0.2), from_t=0.4)
    assert (figures.Cd, figures.abs_Cl, figures.mean_Cl, figures.rms_action) == pytest.approx((0.3, 0.3, 0.1, 0.02))


def test_what_is_written_is_read_back_and_a_damaged_file_counts_as_missing(tmp_path) -> None:
    path = tmp_path / "a.json"
    without_control = RunOutcome(key="k", figures=phase_of().free.figures)
    for outcome in (without_control, phase_of(in_control=3, latches=1, broken=["it broke"]).under):
        save(path, outcome)
        assert load(path) == outcome
        whole = path.read_bytes()
        save(path, outcome)
        assert path.read_bytes() == whole
    damaged = [b"[]", b"{}", b'{"schema": "stillwake-campaign-run/1"}', b"\xff", b"null"]
    for content in (*damaged, *(whole[:length] for length in range(0, len(whole) - 1, 7))):
        path.write_bytes(content)
        assert load(path) is None, content
