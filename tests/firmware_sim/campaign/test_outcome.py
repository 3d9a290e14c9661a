"""Figures of a run, and the file that keeps them."""

import numpy as np
import pytest

from firmware_sim.campaign.outcome import Course, Figures, Outcome, load, save
from tests.firmware_sim.campaign.conftest import phase_of


def course(cl, enabled_t=0.2) -> Course:
    n = np.arange(len(cl), dtype=np.float64)
    return Course.of({"t": 0.2 * n, "Cd": 0.1 * n, "Cl": np.array(cl), "action": 0.0 * n - 0.02}, enabled_t)


def test_means_are_over_the_instants_from_the_end_of_settling_on() -> None:
    figures = Figures.over(course([9.0, 9.0, -0.3, 0.1, 0.5]), from_t=0.4)
    assert figures.Cd == pytest.approx(0.3)
    assert figures.abs_Cl == pytest.approx(0.3)
    assert figures.mean_Cl == pytest.approx(0.1)
    assert figures.rms_action == pytest.approx(0.02)


def test_what_is_written_is_read_back(tmp_path) -> None:
    outcome = phase_of(in_control=3, latches=1, broken=["it broke"]).under
    save(tmp_path / "a.json", outcome)
    assert load(tmp_path / "a.json") == outcome
    save(tmp_path / "b.json", outcome)
    assert (tmp_path / "a.json").read_bytes() == (tmp_path / "b.json").read_bytes()


def test_a_file_that_is_not_one_counts_as_missing(tmp_path) -> None:
    for content in [b"", b"{", b"[]", b"{}", b'{"schema": "stillwake-campaign-run/1"}', b"\xff", b"null"]:
        (tmp_path / "a.json").write_bytes(content)
        assert load(tmp_path / "a.json") is None, content


def test_a_truncated_file_counts_as_missing_at_every_length(tmp_path) -> None:
    save(tmp_path / "a.json", phase_of().under)
    whole = (tmp_path / "a.json").read_bytes()
    for length in range(0, len(whole) - 1, 7):
        (tmp_path / "a.json").write_bytes(whole[:length])
        assert load(tmp_path / "a.json") is None


def test_a_run_without_control_has_no_service(tmp_path) -> None:
    outcome = Outcome(key="k", figures=phase_of().free.figures)
    save(tmp_path / "a.json", outcome)
    assert load(tmp_path / "a.json") == outcome
