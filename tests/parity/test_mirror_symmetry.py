"""A mirror-symmetric program answers the mirrored wake with the mirrored plan, in the reference and in C.

Any program becomes symmetric by averaging each matrix W with R W L, where L and R mirror its input and output: sensors
and hidden units change places in pairs, the action and Cl change sign. Layer norm, ELU and the LSTM's gates do not
mind the order of units. The reference keeps the symmetry to rounding in float64; C sums in another order after the
exchange, so it is held to the parity gate's tolerance for actions.
"""

from collections.abc import Callable
from dataclasses import replace
from functools import partial

import numpy as np
import pytest

from contract.arrays import Array
from contract.config.controller import MpcConfig
from contract.config.learning import ModelConfig
from contract.controller.interface import ControlStep
from contract.errors import LibraryError
from export.gates.parity import control_cases
from export.program.controller_program import ControllerProgram
from export.program.random_program import random_program
from export.program.weights import Linear, Norm
from export.reference.mpc import control_step
from export.to_c.library import c_library
from firmware_sim.in_c.compiler import host_compiler
from firmware_sim.in_c.host_library import CController
from tests.each import each

MODEL = ModelConfig(window=7, latent=4, lstm_width=6, dynamics_width=22, decoder_width=10)
PAIRS = [1, 0, 3, 2]
"""upper_39 and lower_39, base_0 and base_9."""


def units(count: int) -> Array:
    """Hidden units mirrored: the order turned round."""
    return np.eye(count)[::-1]


def with_action(mirror: Array) -> Array:
    """The same with an action at the end, which changes sign."""
    return np.block([[mirror, np.zeros((len(mirror), 1))], [np.zeros((1, len(mirror))), -np.ones((1, 1))]])


def averaged(layer: Linear, outputs: Array, inputs: Array) -> Linear:
    return replace(
        layer,
        weight=(layer.weight + outputs @ layer.weight @ inputs) / 2,
        bias=(layer.bias + outputs @ layer.bias) / 2,
    )


def averaged_norm(norm: Norm) -> Norm:
    return Norm(weight=(norm.weight + norm.weight[::-1]) / 2, bias=(norm.bias + norm.bias[::-1]) / 2)


def symmetric_program(seed: int) -> ControllerProgram:
    program = random_program(seed, model=MODEL, mpc=MpcConfig(horizon=9))
    encoder, dynamics, decoder, scaling = program.encoder, program.dynamics, program.decoder, program.scaling
    window, hidden, latent = with_action(np.eye(4)[PAIRS]), units(MODEL.lstm_width), units(MODEL.latent)
    wide, tall = units(MODEL.dynamics_width), units(MODEL.decoder_width)
    gates = np.kron(np.eye(4), hidden)
    lstm = encoder.lstm
    return replace(
        program,
        scaling=replace(
            scaling,
            pressure_mean=tuple(np.array(scaling.pressure_mean)[[0, 0, 2, 2]].tolist()),
            pressure_std=tuple(np.array(scaling.pressure_std)[[0, 0, 2, 2]].tolist()),
        ),
        encoder=replace(
            encoder,
            lstm=replace(
                lstm,
                weight_input=(lstm.weight_input + gates @ lstm.weight_input @ window) / 2,
                weight_recurrent=(lstm.weight_recurrent + gates @ lstm.weight_recurrent @ hidden) / 2,
                bias_input=(lstm.bias_input + gates @ lstm.bias_input) / 2,
                bias_recurrent=(lstm.bias_recurrent + gates @ lstm.bias_recurrent) / 2,
            ),
            norm=averaged_norm(encoder.norm),
            hidden=averaged(encoder.hidden, hidden, hidden),
            output=averaged(encoder.output, latent, hidden),
        ),
        dynamics=replace(
            dynamics,
            input=averaged(dynamics.input, wide, with_action(latent)),
            norm_in=averaged_norm(dynamics.norm_in),
            hidden=averaged(dynamics.hidden, wide, wide),
            norm_hidden=averaged_norm(dynamics.norm_hidden),
            output=averaged(dynamics.output, latent, wide),
        ),
        decoder=replace(
            decoder,
            input=averaged(decoder.input, tall, latent),
            blocks=tuple(
                replace(block, linear=averaged(block.linear, tall, tall), norm=averaged_norm(block.norm))
                for block in decoder.blocks
            ),
            output=averaged(decoder.output, np.diag([1.0, -1.0]), tall),
        ),
    )


def assert_mirrored(
    program: ControllerProgram, step: Callable[..., ControlStep], actions: float, forces: float
) -> None:
    mirror = with_action(np.eye(4)[PAIRS])
    for case in control_cases(program, count=5):
        one = step(case.window, case.plan, case.free, case.weights)
        other = step(case.window @ mirror, -case.plan, case.free, case.weights)
        np.testing.assert_allclose(other.plan, -one.plan, rtol=0, atol=actions)
        np.testing.assert_allclose(other.forces, one.forces * [1.0, -1.0], rtol=0, atol=forces)
        np.testing.assert_allclose(other.terms, one.terms, rtol=0, atol=forces)
        assert np.abs(one.plan).max() > 1e-3


@each("seed", range(4))
def test_reference(seed):
    program = symmetric_program(seed)
    assert_mirrored(program, partial(control_step, program), 1e-9, 1e-9)


def test_c_library():
    try:
        host_compiler()
    except LibraryError as error:
        pytest.skip(str(error))
    program = symmetric_program(0)
    controller = CController(c_library(program), program.sizes, flags=("-O1",))
    assert_mirrored(program, controller.control_step, 2.5e-5, 1e-4)
