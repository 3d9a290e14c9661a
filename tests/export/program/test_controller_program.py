"""From what training writes to a program: each refusal names the tensor or value at fault, the networks arrive
unchanged, and windows are cut at the right places."""

from dataclasses import replace
from itertools import pairwise
from typing import Any

import numpy as np
import pytest
import torch

from contract import sensors
from contract.arrays import Array
from contract.config.controller import MpcConfig
from contract.config.learning import ModelConfig
from contract.config.tree import Config
from contract.controller.goal import SPEED_SCALE, Goal, schedule
from contract.errors import ExportError
from contract.model import model_folder
from contract.recording.dataset import UNITS, Episode
from contract.release.manifest import Scaling
from examples.random_programs import random_program
from export.program.controller_program import ControllerProgram, program_of, program_sha256, recorded_windows
from export.program.weights import DecoderWeights, DynamicsWeights, EncoderWeights, PriorWeights
from export.reference.model import decode, encode, step
from tests.untrained_model import untrained
from train import model_store
from train.networks.model import WakeModel

H, INPUTS, LATENT, WIDTH = 3, 3, 2, 4


def parts():
    """A complete set of tensors and settings, small and all ones."""
    sizes = ModelConfig(latent=LATENT, lstm_width=H, dynamics_width=6, decoder_width=WIDTH, decoder_blocks=1)
    networks = WakeModel(INPUTS - 1, sizes).named_children()
    return {
        **{name: {key: np.ones(value.shape) for key, value in part.state_dict().items()} for name, part in networks},
        "scaling": Scaling(
            pressure_mean=(0.0, 0.0),
            pressure_std=(1.0, 1.0),
            action_std=0.05,
            force_mean=(1.0, 0.0),
            force_std=(0.1, 0.5),
        ),
        "mpc": MpcConfig(),
        "action_limit": 0.075,
        "sensors": ("base_0", "base_9"),
        "encoder_rows": 4,
        "prior": {
            **{"filters": np.ones((6, 2)), "first": np.ones((6, 3, 2, 2)), "gate": np.ones((3, 6))},
            **{"sums": np.ones((3, 2, 1)), "output": np.ones(3), "predictor": np.ones((1, 6, 2))},
        },
    }


def built(*, encoder: Any, dynamics: Any, decoder: Any, prior: Any, **settings: Any) -> ControllerProgram:
    return ControllerProgram(
        encoder=EncoderWeights.from_state(encoder),
        dynamics=DynamicsWeights.from_state(dynamics),
        decoder=DecoderWeights.from_state(decoder),
        prior=PriorWeights.from_state(prior),
        **settings,
    )


def test_every_tensor_is_needed_and_checked():
    program = built(**parts())
    assert program.latent == LATENT
    assert program.dynamics.hidden.weight.shape == (6, 6)
    assert len(program.decoder.blocks) == 1
    assert program.encoder.hidden.weight.dtype == np.float64
    with pytest.raises(ValueError, match="read-only"):
        program.dynamics.output.bias[0] = 2.0
    assert program.window == 6
    for network in ("encoder", "dynamics", "decoder", "prior"):
        for name, tensor in parts()[network].items():
            missing = parts()
            del missing[network][name]
            with pytest.raises(ExportError, match=rf"{network}\.{name}: tensor is missing"):
                built(**missing)
            longer = parts()
            longer[network][name] = np.ones((tensor.shape[0] + 1, *tensor.shape[1:]))
            with pytest.raises(ExportError, match="must have"):
                built(**longer)
            poisoned = parts()
            poisoned[network][name].flat[-1] = np.nan
            with pytest.raises(ExportError, match=rf"{network}\.{name}: is nan at .*must be finite"):
                built(**poisoned)


def test_a_prior_with_one_variable_for_the_speed_acts_as_it_was_trained():
    old, rng = parts(), np.random.default_rng(1)
    first, gate = old["prior"]["first"], old["prior"]["gate"] = rng.normal(size=(5, 3, 2, 2)), rng.normal(size=(3, 5))
    prior = built(**old).prior
    assert prior is not None and prior.knows_speed
    for speed in (0.6, 1.0, 1.3):
        now, before = schedule(speed, Goal(0.2, 0.3, 0.4)), (1.0, (speed - 1.0) / SPEED_SCALE, 0.2, 0.3, 0.4)
        np.testing.assert_allclose(np.tensordot(now, prior.first, 1), np.tensordot(before, first, 1), atol=1e-12)
        np.testing.assert_allclose(prior.gate @ now, gate @ before, atol=1e-12)
    # Its identity is that of its own weights too, so bundles of such a model stay valid.
    as_trained = replace(built(**old), prior=replace(prior, first=first, gate=gate))
    assert program_sha256(built(**old)) == program_sha256(as_trained)


def test_what_does_not_fit_is_refused_by_its_name():
    def scaled(**changes: object) -> dict[str, Any]:
        return {"scaling": Scaling(**{**vars(parts()["scaling"]), **changes})}

    def tensor(network: str, name: str, *shape: int) -> dict[str, Any]:
        return {network: {**parts()[network], name: np.ones(shape)}}

    cases: list[tuple[dict[str, Any], str]] = [
        (tensor("prior", "first", 6, 3, 2, 3), r"prior\.sums: has shape"),
        (tensor("prior", "first", 4, 3, 2, 2), r"prior\.first: has 4 variables, but must have 6: one, slower, "),
        (tensor("prior", "first", 3, 2, 2), r"prior\.first: has shape \(3, 2, 2\), but needs 4 axes"),
        (tensor("prior", "slope", 3, 2, 2), r"prior\.first: has shape \(6, 3, 2, 2\), but needs 3 axes"),
        (tensor("prior", "hidden", 3, 6, 2), r"prior\.f\w+: unknown tensor"),
        (scaled(pressure_std=(1.0, 0.0)), r"scaling\.pressure_std"),
        (scaled(pressure_mean=(float("nan"), 0.0)), r"scaling\.pressure_mean"),
        (scaled(action_std=0.0), r"scaling\.action_std"),
        (scaled(force_std=(0.1, -1.0)), r"scaling\.force_std"),
        (tensor("decoder", "input.weight", WIDTH, LATENT + 1), "decoder: the latent size is 3, but the encoder's is 2"),
        (tensor("encoder", "lstm.weight_ih_l0", 4 * H, INPUTS + 2), r"weight_ih_l0: has 5 inputs, but must have 3"),
        (tensor("dynamics", "gate.weight", 2, 2), r"dynamics\.gate\.weight: unknown tensor"),
    ]
    for change, message in cases:
        with pytest.raises(ExportError, match=message):
            built(**{**parts(), **change})


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
        after = trained.teacher.dynamics(z, torch.tensor(0.05 / 0.04))
        forces = trained.teacher.decoder(after).numpy() * trained.scaling.force_std + trained.scaling.force_mean
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
        with pytest.raises(ExportError, match="episode chirp has 6 steps"):
            recorded_windows(PROGRAM, episode(6), count)
