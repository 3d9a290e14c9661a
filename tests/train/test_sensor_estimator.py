"""The sensor estimator on a made-up flow whose sensors all follow one oscillation."""

import numpy as np
import pytest

from contract.arrays import Array
from contract.controller.estimator import EstimatorNetwork
from contract.errors import ConfigError, DatasetError
from contract.recording.dataset import Dataset, Episode
from contract.recording.episode import Role
from contract.sensors import TRUCK
from export.release.estimator import lowered_estimator
from train.sensor_estimator import fit_estimator

CHOSEN = ("upper_39", "base_0", "lower_36")
WINDOW = 8


def episode(name: str, role: Role, steps: int, *, constant: bool = False) -> Episode:
    """Every sensor has an amplitude and a phase of its own; the phase runs unevenly."""
    rng = np.random.default_rng(len(name))
    phase = np.cumsum(rng.uniform(0.15, 0.25, steps))
    shifts, sizes = np.linspace(0.0, 2.0, len(TRUCK)), np.linspace(0.2, 0.4, len(TRUCK))
    cp = -0.3 + sizes * np.sin(phase[:, None] + shifts)
    if constant:
        cp[:, TRUCK.indices(["base_0"])] = -0.3
    series: dict[str, Array] = {"t": 0.2 * np.arange(float(steps)), "action": rng.normal(0.0, 0.05, steps), "Cp": cp}
    series |= {"Cd": np.ones(steps), "Cl": np.sin(phase)}
    return Episode(name=name, role=role, series=series, initial_action=0.0, provenance={})


RECORDING = Dataset(episodes=(episode("a", "train", 600), episode("test", "test", 400)))


@pytest.fixture(scope="module")
def fitted() -> EstimatorNetwork:
    done: list[tuple[int, int]] = []
    made = fit_estimator(RECORDING, CHOSEN, WINDOW, epochs=300, progress=lambda *at: done.append(at))
    assert done[-1][0] == done[-1][1] == len(done)
    return made


@pytest.mark.slow  # some hundred batches
def test_sensors_that_follow_one_motion_are_known_by_each_other(fitted):
    made = lowered_estimator(fitted, RECORDING, CHOSEN, {"torch_threads": 1})
    assert (made.provenance["torch_threads"], made.provenance["judged_on"]) == (1, ("test",))
    assert made.provenance["r2"].keys() == set(CHOSEN) and min(made.provenance["r2"].values()) > 0.9
    # A slower mean has less of what changes sign.
    assert np.all(np.array(made.figures.slow) < np.array(made.figures.fast))


@pytest.mark.slow  # the same
def test_in_a_gust_that_the_speed_does_not_show_the_others_tell_what_a_sensor_reads(fitted):
    test = RECORDING.with_role("test")[0]
    readings = test.series["Cp"][:, RECORDING.layout.indices(CHOSEN)]
    left = []
    for factor in (1.0, 1.1**2):
        rows = np.column_stack([factor * readings, test.previous_action])
        windows = np.lib.stride_tricks.sliding_window_view(rows, WINDOW, axis=0).transpose(0, 2, 1)
        estimates = fitted.estimates(windows)[:, : len(CHOSEN)]
        left.append(np.abs(np.einsum("nii->ni", estimates) - windows[:, -1, :-1]).mean())
    assert left[1] < 2.0 * left[0], left


def test_a_recording_that_does_not_do_is_refused():
    for recording, sensors, error, named in (
        (Dataset(episodes=(episode("a", "train", 60),)), ("upper_39", "nose"), ConfigError, "nose"),
        (Dataset(episodes=(episode("a", "train", 8),)), CHOSEN, DatasetError, "longer than the window of 8"),
        (Dataset(episodes=(episode("a", "train", 60, constant=True),)), ("upper_39", "base_0"), DatasetError, "base_0"),
    ):
        with pytest.raises(error, match=named):
            fit_estimator(recording, sensors, WINDOW, epochs=1)
