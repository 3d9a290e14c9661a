"""ONNX graph and C library of linear controllers = NumPy reference, at odd sizes."""

from dataclasses import replace

import numpy as np
import pytest

from contract.config.controller import MpcConfig
from contract.controller.interface import ControllerError
from contract.errors import ExportError
from examples.random_programs import random_linear_program
from export.gates.parity import check_lowering, check_parity
from export.program.linear_program import LinearProgram
from export.program.random_windows import random_windows
from export.release.judged import check_model
from export.to_c.linear_library import linear_c_library
from export.to_onnx.linear_step import build_linear_controller
from firmware_sim.in_c.host_library import CController
from tests.each import each

NAMES = ("upper_39", "lower_39", "base_0", "base_9", "upper_07", "lower_07", "base_3", "base_6")
SIZES = ((1, 2, 2), (2, 64, 25), (3, 7, 9), (4, 12, 31))
"""Pairs, window, horizon."""
FAST_BUILD = ("-O1",)


def program_of(seed: int) -> LinearProgram:
    pairs, window, horizon = SIZES[seed]
    return random_linear_program(
        seed, window=window, mpc=MpcConfig(horizon=horizon, drag_reference=0.9), sensors=NAMES[: 2 * pairs]
    )


def in_c(program: LinearProgram) -> CController:
    return CController(linear_c_library(program), program.sizes, flags=FAST_BUILD)


@each("seed", range(len(SIZES)))
def test_the_graph_computes_the_reference(seed):
    program = program_of(seed)
    graph = build_linear_controller(program).SerializeToString()
    check_model(graph)
    check_parity(program, graph, random_windows(program, 10, seed=seed))


@pytest.mark.compiler
@each("seed", range(len(SIZES)))
def test_the_library_computes_the_reference(seed):
    program = program_of(seed)
    check_lowering(program, in_c(program), "C library", random_windows(program, 10, seed=seed))


def test_a_planted_difference_is_found():
    """A thousandth of one number of the gain."""
    program = program_of(1)
    gain = program.gain.copy()
    gain[-1, 0] += 1e-3
    wrong = build_linear_controller(replace(program, gain=gain)).SerializeToString()
    with pytest.raises(ExportError, match=r"differ by .* in action"):
        check_parity(program, wrong, random_windows(program, 4))


@pytest.mark.compiler
def test_the_library_needs_no_prepared_memory_and_says_what_is_not_finite():
    program = program_of(2)
    controller = in_c(program)
    (window,) = random_windows(program, 1)
    plan, free = np.zeros(program.mpc.horizon), np.ones(program.mpc.horizon)
    first = controller.control_step(window, plan, free)
    controller.poison_workspace()
    again = controller.control_step(window, plan, free)
    np.testing.assert_array_equal(first.plan, again.plan)
    assert first.cost == again.cost
    # The oldest row's action is no input of the model, and still no number that is to be trusted.
    for place in ((-1, 0), (0, -1)):
        broken = window.copy()
        broken[place] = np.nan
        with pytest.raises(ControllerError, match="not finite"):
            controller.control_step(broken, plan, free)


def test_a_number_that_float32_cannot_hold_is_refused():
    program = program_of(0)
    huge = replace(program, model=program.model * 1e40)
    for lower in (build_linear_controller, linear_c_library):
        with pytest.raises(ExportError, match="too large for float32"):
            lower(huge)
