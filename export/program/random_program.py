"""Programs with random weights of a trained net's size, for parity tests, budgets and benchmarks.

The time and memory of a control step depend on the shapes only, so these stand in where no model is at hand.
"""

import numpy as np

from contract.arrays import Array
from contract.config.controller import MpcConfig
from contract.config.learning import ModelConfig
from contract.release.manifest import Scaling
from export.program.controller_program import ControllerProgram
from export.program.linear_program import LinearProgram

SENSORS = ("upper_39", "lower_39", "base_0", "base_9")


def random_program(
    seed: int,
    *,
    model: ModelConfig | None = None,
    mpc: MpcConfig | None = None,
    action_limit: float = 0.075,
    sensors: tuple[str, ...] = SENSORS,
) -> ControllerProgram:
    """A program with weights drawn as PyTorch initialises them, norms perturbed so that none is the identity.

    Args:
        seed: of the draw.
        model: widths and window; the paper's if None.
        mpc: optimiser settings; the paper's if None.
    """
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
    return ControllerProgram.from_state(
        encoder=encoder,
        dynamics=dynamics,
        decoder=decoder,
        scaling=_scaling(rng, sensors, action_limit),
        mpc=MpcConfig() if mpc is None else mpc,
        action_limit=action_limit,
        sensors=sensors,
        window=model.window,
    )


def random_window(program: ControllerProgram | LinearProgram, rng: np.random.Generator) -> Array:
    """A window (L, S+1) with the roughness of recorded ones: each column a few slow random sines.

    Pressures have the mean and spread of the program's scaling, actions stay within its limit.
    """
    columns = len(program.sensors) + 1
    t = np.arange(program.window)[:, None, None]
    frequency = rng.uniform(0.01, 0.1, (1, columns, 3))
    waves = np.sin(2 * np.pi * (frequency * t + rng.random((1, columns, 3)))).mean(axis=-1)
    pressure = np.array(program.scaling.pressure_mean) + 2.0 * waves[:, :-1] * program.scaling.pressure_std
    return np.column_stack([pressure, waves[:, -1] * program.action_limit])


def random_windows(program: ControllerProgram | LinearProgram, count: int, *, seed: int = 0) -> list[Array]:
    """So many windows, each by itself: not consecutive ones."""
    rng = np.random.default_rng(seed)
    return [random_window(program, rng) for _ in range(count)]


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
        # The uncontrolled wake's means and spreads, roughly.
        force_mean=(1.0, 0.0),
        force_std=(0.1, 0.8),
    )
