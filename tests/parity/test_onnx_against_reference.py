"""Second link of the chain: ONNX under ONNX Runtime = NumPy reference, for float and for int8 weights.

The int8 graph is compared with the reference running on the dequantised weights, so the tolerance is the same:
both graphs compute in float32 (`export.gates` explains the figures).
"""

from dataclasses import replace

import numpy as np
import pytest

from contract.config.controller import CostWeights, MpcConfig
from contract.config.learning import ModelConfig
from contract.controller.goal import SCHEDULED
from contract.errors import ExportError
from contract.runtime.onnx_session import OnnxController
from examples.random_programs import random_program
from export.gates import Figures, check_lowering
from export.int8 import Program, effective, rounded_to_nearest
from export.program.controller_program import ControllerProgram, random_window, random_windows
from export.to_onnx.control_step import build_controller
from tests.each import each
from tests.parity.drawn import drawn_program

pytestmark = pytest.mark.slow  # seconds of graphs built and run, one for each size

SMALL = ModelConfig(window=6, latent=3, lstm_width=5, dynamics_width=12, decoder_width=8)
LOWERINGS = (lambda program: program, rounded_to_nearest)


def check_graph(of: ControllerProgram, lowered: Program, windows: list[np.ndarray]) -> Figures:
    controller = OnnxController(build_controller(lowered).SerializeToString(), of.sizes)
    return check_lowering(of, controller, "ONNX graph", windows)


@each("round_weights", LOWERINGS)
@each("seed", (1, 2))
def test_random_small_nets(seed, round_weights):
    lowered = round_weights(program := drawn_program(seed))
    check_graph(effective(lowered), lowered, random_windows(program, 6, seed=seed))


@each("round_weights", LOWERINGS)
def test_paper_size(round_weights):
    lowered = round_weights(program := random_program(11))
    report = check_graph(effective(lowered), lowered, random_windows(program, 4, seed=1))
    # Far from the small gradients and kinks that the gate leaves room for, actions agree to float32's rounding.
    assert report["action"] < 2e-6


def test_large_forces_are_compared_relative_to_the_largest():
    # Forces per span of another body; float32 has 24 bits of them.
    program = random_program(4, model=SMALL, mpc=MpcConfig(horizon=6))
    scaling = replace(program.scaling, force_mean=(100.0, -300.0), force_std=(20.0, 300.0))
    large = replace(program, scaling=scaling)
    check_graph(large, large, random_windows(large, 6))
    wrong = replace(large, scaling=replace(scaling, force_std=(20.0, 300.3)))
    with pytest.raises(ExportError, match="and reference differ by"):
        check_graph(large, wrong, random_windows(large, 6))


def test_the_speed_is_an_input_where_the_plan_depends_on_it():
    program = random_program(2, model=SMALL, mpc=MpcConfig(horizon=6), prior_memory=24)
    prior = program.prior
    assert prior is not None
    without = ~np.isin(SCHEDULED, ("slower", "faster"))
    first, gate = (prior.first.T * without).T, prior.gate * without
    blind = replace(program, prior=replace(prior, first=first, gate=gate))
    window = random_window(program, np.random.default_rng(0))
    for one, names in ((program, ["speed", "limit"]), (blind, ["limit"])):
        graph = build_controller(one)
        assert [item.name for item in graph.graph.input][4:] == names
        controller = OnnxController(graph.SerializeToString(), one.sizes)
        slow, given, default = (
            controller.control_step(window, np.zeros(6), np.ones(6), None, *speed).plan for speed in ([0.6], [1.0], [])
        )
        np.testing.assert_array_equal(given, default)
        assert np.array_equal(slow, default) == (one is blind)


def test_actions_stay_within_a_limit_that_float32_rounds_up_and_committed_ones_come_back_to_the_bit():
    limit = 0.075
    assert float(np.float32(limit)) > limit
    mpc = MpcConfig(horizon=6, iterations=20, learning_rate=0.2, weights=CostWeights(smoothness=0.0))
    program = random_program(6, model=SMALL, mpc=mpc, action_limit=limit)
    controller = OnnxController(build_controller(program).SerializeToString(), program.sizes)
    rng = np.random.default_rng(0)
    plan = rng.uniform(-0.07, 0.07, 6).astype(np.float32).astype(np.float64)
    free, shifted, touched = np.array([0.0, 1.0, 1.0, 0.0, 1.0, 1.0]), np.append(plan[1:], plan[-1]), 0.0
    for _ in range(10):
        found = controller.control_step(random_window(program, rng), plan, free).plan
        assert np.abs(found).max() <= limit
        touched = max(touched, np.abs(found).max())
        np.testing.assert_array_equal(found[free == 0], shifted[free == 0])
        assert (found[free == 1] != shifted[free == 1]).all()
    assert touched == pytest.approx(limit, rel=1e-6)
