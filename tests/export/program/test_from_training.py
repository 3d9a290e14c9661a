"""From what training writes to a program: the networks arrive unchanged, and windows are cut at the right places."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
import torch

from contract import sensors
from contract.arrays import Array
from contract.config.controller import MpcConfig
from contract.config.learning import ModelConfig
from contract.config.tree import Config
from contract.errors import ExportError
from contract.model import model_folder
from contract.recording.dataset import UNITS, Episode
from examples.random_programs import random_program
from export.program.controller_program import program_of
from export.program.windows import recorded_windows
from export.reference.model import decode, encode, step
from tests.untrained_model import untrained
from train import model_store

MODEL = ModelConfig(window=6, latent=3, lstm_width=5, dynamics_width=10, decoder_width=8, decoder_blocks=3)
CHOSEN = ("base_9", "upper_39", "base_0", "lower_39")


@pytest.fixture
def trained():
    drawn = random_program(0, sensors=sensors.NAMES).scaling
    return untrained(Config(model=MODEL), replace(drawn, action_std=0.04, force_mean=(1.0, 0.1)), CHOSEN)


@pytest.fixture
def directory(trained, tmp_path):
    model_store.save(tmp_path / "model", trained)
    return tmp_path / "model"


def test_the_networks_compute_what_the_trained_modules_do(directory, trained):
    """Float32 modules against the float64 reference: 1e-5."""
    mpc = MpcConfig(horizon=7, iterations=2)
    program = program_of(model_folder.read(directory), mpc)
    assert (program.mpc, program.window, program.sensors) == (mpc, 6, CHOSEN)
    assert program.action_limit == trained.config.flow.action_limit
    rng = np.random.default_rng(1)
    chosen = sensors.TRUCK.indices(CHOSEN)
    pressure, action = rng.normal(size=(6, 4)), rng.uniform(-0.07, 0.07, 6)
    scaled = (pressure - np.array(trained.scaling.pressure_mean)[chosen]) / np.array(trained.scaling.pressure_std)[
        chosen
    ]
    rows = torch.tensor(np.column_stack([scaled, action / 0.04]), dtype=torch.float32)
    with torch.no_grad():
        z = trained.slim(rows[None])[0]
        after = trained.deployed.dynamics(z, torch.tensor(0.05 / 0.04))
        forces = trained.deployed.decoder(after).numpy() * trained.scaling.force_std + trained.scaling.force_mean
    found = encode(program, np.column_stack([pressure, action]))
    np.testing.assert_allclose(found, z.numpy(), atol=1e-5)
    found = step(program, found, np.array(0.05))
    np.testing.assert_allclose(found, after.numpy(), atol=1e-5)
    np.testing.assert_allclose(decode(program, found), forces, atol=1e-5)


def test_the_narrow_networks_go_on_the_vehicle_where_there_are_any(directory, trained):
    """And of the wide ones nothing is left in the program."""
    read = model_folder.read(directory)
    narrow = {f"slim_{key}": 2.0 * value for key, value in read.tensors.items() if key.startswith("decoder.")}
    program = program_of(replace(read, tensors={**read.tensors, **narrow}), MpcConfig())
    wide = program_of(read, MpcConfig())
    np.testing.assert_array_equal(program.decoder.output.weight, 2.0 * wide.decoder.output.weight)
    np.testing.assert_array_equal(program.dynamics.output.weight, wide.dynamics.output.weight)
    # Weights for other sensors are refused.
    read = model_folder.read(directory)
    fewer = replace(read, description=replace(read.description, sensors=CHOSEN[:2]))
    with pytest.raises(ExportError, match=r"lstm\.weight_ih_l0"):
        program_of(fewer, MpcConfig())


PROGRAM = random_program(0, model=ModelConfig(window=3, lstm_width=2, dynamics_width=4, decoder_width=4))


def episode(steps: int) -> Episode:
    series: dict[str, Array] = {name: np.zeros(steps) for name in UNITS}
    step = np.arange(steps, dtype=np.float64)
    series["Cp"] = 100.0 * step[:, None] + np.arange(sensors.COUNT)
    series["action"] = 0.001 * step
    return Episode(name="chirp", role="test", series=series, initial_action=-0.05, provenance={})


def test_rows_pair_pressures_with_the_action_before_them():
    *_, last = recorded_windows(PROGRAM, episode(6), 2)
    # upper_39, lower_39, base_0, base_9 are sensors 39, 79, 80, 89.
    np.testing.assert_array_equal(last[-1, :4], [539, 579, 580, 589])
    np.testing.assert_allclose(last[:, -1], [0.002, 0.003, 0.004])
    # Windows are consecutive and reach back to the action in force at the start.
    windows = recorded_windows(PROGRAM, episode(6), 4)
    assert windows[0][0, -1] == -0.05
    for earlier, later in pairwise(windows):
        np.testing.assert_array_equal(earlier[1:], later[:-1])
    # An episode that is too short is refused.
    for count in (0, 5):
        with pytest.raises(ExportError, match="episode chirp: 6 steps"):
            recorded_windows(PROGRAM, episode(6), count)
