"""Tuning the vehicle's networks: its weights by their formula, and a plant whose forces are known."""

import numpy as np
import pytest
import torch

from benchmarks.common.command_line import MODEL
from benchmarks.roads.calm_tuning import Tuning, tune, weights_of
from contract import sensors
from contract.model import model_folder
from contract.recording.dataset import Episode
from export.program.from_training import program_of
from export.reference.model import decode, encode
from train import model_store

CALM_DRAG = 0.65


def test_windows_weigh_by_one_over_their_lift():
    lift = torch.tensor([[0.0, 0.1, -1.9], [0.0, -0.3, 1.9]])
    forces = torch.stack([torch.full_like(lift, 7.0), lift], dim=-1)
    # Means 0, 0.2 and 1.9 of |Cl|: 10, 10/3 and 1/2.
    expected = np.array([10.0, 10.0 / 3.0, 0.5])
    assert weights_of(forces).numpy() == pytest.approx(expected / expected.mean(), rel=1e-5)


def calm_episode(seed: int, steps: int = 120) -> Episode:
    """Pressures that tremble about those of no flow we know, and forces that do not."""
    generator = np.random.default_rng(seed)
    return Episode(
        name=f"calm_{seed}",
        role="train",
        series={
            "t": 0.2 * np.arange(steps, dtype=np.float64),
            "action": 0.002 * generator.standard_normal(steps),
            "Cp": -0.17 + 0.01 * generator.standard_normal((steps, sensors.COUNT)),
            "Cd": np.full(steps, CALM_DRAG),
            "Cl": np.zeros(steps),
        },
        initial_action=0.0,
        provenance={},
    )


def test_the_tuned_networks_know_a_wake_that_the_release_has_not_seen(tmp_path):
    source, model = model_folder.read(MODEL), model_store.load(MODEL)
    tuning = Tuning(steps=60, unroll=3, segment=8, batch_size=64)
    tuned = tune(model, [calm_episode(1), calm_episode(2)], tuning, range(tuning.steps))
    assert {name: value.shape for name, value in tuned.items()} == {
        name: value.shape for name, value in source.tensors.items() if name.startswith("slim")
    }
    model_folder.write(tmp_path / "model", source.description, {**source.tensors, **tuned})
    # An episode that was not learned from, through the vehicle's program in NumPy.
    unseen, errors = calm_episode(3), list[float]()
    columns = source.description.layout.indices(source.description.sensors)
    rows = np.column_stack([unseen.series["Cp"][:, columns], unseen.previous_action])
    for folder in (MODEL, tmp_path / "model"):
        program = program_of(model_folder.read(folder), source.description.config.mpc)
        drag = [decode(program, encode(program, rows[k : k + program.window]))[0] for k in range(0, 80, 8)]
        errors.append(np.abs(np.array(drag) - CALM_DRAG).mean())
    assert errors[1] < 0.25 * errors[0]
