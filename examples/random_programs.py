"""Programs with random weights, as large as a trained model's program. They need no trained model.

Time and memory of a control step depend only on the weights' shapes, so both can be measured with these programs.
"""

import numpy as np

from contract.arrays import Array
from contract.config.controller import MpcConfig
from contract.config.learning import ModelConfig
from contract.controller.goal import SCHEDULED
from contract.release.manifest import Scaling
from export.program.controller_program import ControllerProgram
from export.program.weights import DecoderWeights, DynamicsWeights, EncoderWeights, PriorWeights

SENSORS = ("upper_39", "lower_39", "base_0", "base_9")


def random_program(
    seed: int,
    *,
    model: ModelConfig | None = None,
    mpc: MpcConfig | None = None,
    action_limit: float = 0.075,
    sensors: tuple[str, ...] = SENSORS,
    prior_memory: int = 0,
) -> ControllerProgram:
    """Return a program with random weights, distributed as in PyTorch's initialisation. Gains and offsets of the layer
    norms are also random, so that no norm is the identity. `model` and `mpc` are the settings of the networks and of
    the optimiser, None for the paper's values. `prior_memory` is the number of rows that the prior reads, 0 for no
    prior. The prior has five units, which read the speed, the goal, and the sums of the sensor pairs."""
    rng = np.random.default_rng(seed)
    model = ModelConfig() if model is None else model
    inputs, h, latent = len(sensors) + 1, model.lstm_width, model.latent
    encoder = {
        "lstm.weight_ih_l0": _uniform(rng, (4 * h, inputs), h),
        "lstm.weight_hh_l0": _uniform(rng, (4 * h, h), h),
        "lstm.bias_ih_l0": _uniform(rng, (4 * h,), h),
        "lstm.bias_hh_l0": _uniform(rng, (4 * h,), h),
        **_norm(rng, "norm", h),
        **_linear(rng, "hidden", h, h),
        **_linear(rng, "output", latent, h),
    }
    dynamics = {
        **_linear(rng, "input", model.dynamics_width, latent + 1),
        **_norm(rng, "norm_in", model.dynamics_width),
        **_linear(rng, "hidden", model.dynamics_width, model.dynamics_width),
        **_norm(rng, "norm_hidden", model.dynamics_width),
        **_linear(rng, "output", latent, model.dynamics_width),
    }
    width = model.decoder_width
    decoder = {**_linear(rng, "input", width, latent), **_linear(rng, "output", 2, width)}
    for i in range(model.decoder_blocks):
        decoder |= _linear(rng, f"blocks.{i}.linear", width, width) | _norm(rng, f"blocks.{i}.norm", width)
    return ControllerProgram(
        encoder=EncoderWeights.from_state(encoder),
        dynamics=DynamicsWeights.from_state(dynamics),
        decoder=DecoderWeights.from_state(decoder),
        scaling=_scaling(rng, sensors, action_limit),
        mpc=MpcConfig() if mpc is None else mpc,
        action_limit=action_limit,
        sensors=sensors,
        encoder_rows=model.window,
        prior=PriorWeights.from_state(_prior(rng, len(sensors) // 2, prior_memory)) if prior_memory else None,
    )


def _prior(rng: np.random.Generator, pairs: int, memory: int) -> dict[str, Array]:
    """Return weights of a prior whose units are not negligible and whose predicted differences decay slowly."""
    predictor = rng.normal(0.0, 0.3 / np.sqrt(memory), (pairs, memory, pairs + 1))
    predictor[np.arange(pairs), -1, np.arange(pairs)] += 0.7
    # The first filter covers all rows; each other filter covers a few rows.
    count = min(memory, 7)
    filters = np.triu(np.tril(rng.uniform(0.0, 1.0, (memory, count)), 2), -1)
    filters[:, 0] = rng.uniform(0.0, 1.0, memory)
    return {
        "filters": filters,
        "first": rng.normal(0.0, 1.0 / np.sqrt(count), (len(SCHEDULED), 5, count, pairs + 1)),
        "gate": rng.normal(0.0, 0.5, (5, len(SCHEDULED))),
        "sums": rng.normal(0.0, 0.2 / np.sqrt(count), (5, count, pairs)),
        "output": rng.normal(0.0, 0.5, 5),
        "predictor": predictor,
    }


def _uniform(rng: np.random.Generator, shape: tuple[int, ...], fan_in: int) -> Array:
    bound = 1.0 / np.sqrt(fan_in)
    return rng.uniform(-bound, bound, shape)


def _linear(rng: np.random.Generator, name: str, outputs: int, inputs: int) -> dict[str, Array]:
    return {
        f"{name}.weight": _uniform(rng, (outputs, inputs), inputs),
        f"{name}.bias": _uniform(rng, (outputs,), inputs),
    }


def _norm(rng: np.random.Generator, name: str, width: int) -> dict[str, Array]:
    return {f"{name}.weight": rng.normal(1.0, 0.2, width), f"{name}.bias": rng.normal(0.0, 0.1, width)}


def _scaling(rng: np.random.Generator, sensors: tuple[str, ...], action_limit: float) -> Scaling:
    count = len(sensors)
    return Scaling(
        pressure_mean=tuple(rng.normal(-0.5, 0.2, count).tolist()),
        pressure_std=tuple(rng.uniform(0.05, 0.3, count).tolist()),
        action_std=0.6 * action_limit,
        # These are approximately the means and standard deviations of the uncontrolled wake's forces.
        force_mean=(1.0, 0.0),
        force_std=(0.1, 0.8),
    )
