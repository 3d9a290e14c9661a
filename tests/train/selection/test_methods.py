"""One door to all methods: what it refuses, and that each keeps to its budget."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from contract import sensors
from contract.errors import ConfigError
from contract.sensor_layout import SensorLayout
from train.networks.model import Encoder, WakeModel
from train.networks.samples import Rows
from train.selection import methods
from train.selection.methods import RidgeStudent, ridge_student


@pytest.fixture
def encoder(small_config) -> Encoder:
    return WakeModel(90, small_config.model).encoder


@pytest.mark.slow  # a ranking by SHAP
def test_every_method_chooses_as_many_as_asked(encoder, rows, small_config):
    settings = replace(small_config.train, shap_background=4, shap_explained=5, shap_samples=2)
    for method in methods.METHODS:
        names = methods.select(method, encoder, rows, 3, settings=settings)
        assert len(sensors.TRUCK.indices(names)) == 3, method  # refuses unknown and repeated names
        for count in (0, 91):
            with pytest.raises(ConfigError, match=rf"train\.sensors = {count}: must be from 1 to 90"):
                methods.select(method, encoder, rows, count, settings=settings)
    with pytest.raises(ConfigError, match=r"'entropy': use shap, qr, greedy, random, hand$"):
        methods.select("entropy", encoder, rows, 4, settings=small_config.train)  # type: ignore[arg-type]


HEARD = ("lower_35", "base_0", "upper_12")


@pytest.fixture(scope="module")
def student(listener, noise_rows) -> RidgeStudent:
    """Of a teacher with two latents, which depends on three sensors; the first the most."""
    teacher = listener((("lower_35", 0, 2.0), ("base_0", 12, 1.0)), (("base_0", 4, -1.0), ("upper_12", 8, 0.7)))
    return ridge_student(teacher, noise_rows((3000,)), seed=0)


def test_greedy_finds_the_sensors_the_latents_are_made_of_the_weightiest_first(student):
    reports = []
    chosen = methods.select_greedy(student, 3, progress=lambda *now: reports.append(now))
    assert tuple(sensors.NAMES[index] for index in chosen) == HEARD
    assert student.error(chosen) < 1e-6
    # Squared weights: 4, 1 + 1 and 0.49 of 6.49; the samples' variances are unity to a few per cent.
    assert [terms["error"] for *_, terms in reports] == pytest.approx([2.49 / 6.49, 0.49 / 6.49, 0.0], abs=0.03)


def test_random_is_the_best_of_its_own_draws(student):
    drawn = methods.draw_choices(20, 12, seed=4, available=sensors.COUNT)
    assert all(len(set(chosen)) == 20 for chosen in drawn)
    assert len(set(drawn)) == 12
    found = methods.select_random(student, 20, draws=12, seed=4)
    assert found in drawn
    assert all(student.error(found) <= student.error(chosen) for chosen in drawn)
    # 20 of 90 hold lower_35, two thirds of the power, in 2 of 9 draws: the best of these does.
    assert sensors.NAMES.index("lower_35") in found


PEAKS = (12, 83, 55)
"""Sensor where each mode is largest."""


def rows_of(pressure: np.ndarray) -> Rows:
    inputs = torch.from_numpy(np.column_stack([pressure, np.zeros(len(pressure))]).astype(np.float32))
    zeros = torch.zeros(len(inputs))
    return Rows(inputs=inputs, actions=zeros, forces=torch.zeros(len(inputs), 2), lengths=(len(inputs),))


def test_pivots_are_the_peaks_of_disjoint_modes():
    # Three modes on disjoint sensors, each largest at its peak, with amplitudes that do not correlate.
    modes = np.zeros((sensors.COUNT, 3))
    for number, peak in enumerate(PEAKS):
        modes[[peak - 1, peak, peak + 1], number] = 1.0, 2.0, 1.0
    t = 2 * np.pi * np.arange(400) / 400
    rows = rows_of(np.column_stack([3.0 * np.sin(t), 2.0 * np.cos(2 * t), np.sin(5 * t)]) @ modes.T)
    for count in (1, 2, 3):
        assert set(methods.select_qr(rows, count)) == set(PEAKS[:count])
    # Sensors 10 and 11 hear the same amplitude, 70 another at half the strength: QR takes one of the two, then 70.
    pressure = np.zeros((400, sensors.COUNT))
    pressure[:, 10] = pressure[:, 11] = np.sin(t)
    pressure[:, 70] = 0.5 * np.cos(t)
    first, second = methods.select_qr(rows_of(pressure), 2)
    assert {first, second} in ({10, 70}, {11, 70})


def test_the_choice_is_symmetric_and_grows_from_the_rear_corners():
    assert [sensors.NAMES[index] for index in methods.select_by_hand(4)] == ["upper_39", "lower_39", "base_0", "base_9"]
    for count in range(1, 91):
        chosen = methods.select_by_hand(count)
        assert len(set(chosen)) == count
        image = set(np.array(sensors.TRUCK.mirror)[list(chosen)].tolist())
        assert len(set(chosen) - image) == count % 2, count
        assert count % 2 == 0 or set(chosen) - image == {chosen[-1]}
    # None left out is nearer to a corner along its own wall.
    corner = np.array([sensors.TRUCK.positions[:, 0].max(), 0.5])
    position = np.abs(sensors.TRUCK.positions)
    distance = np.abs(position - corner).sum(axis=1)
    for count in range(2, 91, 2):
        inside = np.isin(np.arange(90), methods.select_by_hand(count))
        for wall in (slice(0, 80), sensors.BASE):
            taken, left = distance[wall][inside[wall]], distance[wall][~inside[wall]]
            # The paper prints one base position a hundred-thousandth off its mirror image.
            assert not len(taken) or not len(left) or taken.max() < left.min() + 1e-4
    # Any symmetric body has a choice outward from its rear corners.
    names = ("nose", "roof", "floor", "top", "centre", "bottom")
    places = np.array([[0.0, 0.0], [0.8, 0.3], [0.8, -0.3], [1.0, 0.2], [1.0, 0.0], [1.0, -0.2]])
    layout = SensorLayout.of(names, places, base=(3, 4, 5))
    order = [names[index] for index in methods.select_by_hand(6, layout)]
    assert order == ["roof", "floor", "top", "bottom", "centre", "nose"]
    for base, symmetric, message in (((3, 4, 5), False, "have no mirror images"), ((), True, "have no base")):
        with pytest.raises(ConfigError, match=f"'hand': these sensors {message}"):
            methods.select_by_hand(2, SensorLayout.of(names, places, base=base, symmetric=symmetric))
