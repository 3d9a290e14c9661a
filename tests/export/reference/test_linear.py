"""The specification of a linear control step against the closed loop written out by hand."""

from dataclasses import replace

import numpy as np
import pytest

from contract.config.controller import MpcConfig
from contract.errors import ExportError
from examples.random_programs import random_linear_program
from export.program.program_hash import program_sha256
from export.program.random_windows import random_window
from export.reference.history import history_of
from export.reference.linear import linear_control_step

H = 6
PROGRAM = random_linear_program(3, window=4, mpc=MpcConfig(horizon=H))
WINDOW = random_window(PROGRAM, np.random.default_rng(1))


def answer(program=PROGRAM, window=WINDOW, plan=None, free=None):
    return linear_control_step(
        program, window, np.zeros(H) if plan is None else plan, np.ones(H) if free is None else free
    )


def test_it_follows_the_closed_loop_of_a_scalar_system():
    """y_{k+1} = 0.9 y_k + 2 a_k, a = -0.3 y: y decays by 0.3 a step, Cl is the last difference."""
    program = replace(
        PROGRAM,
        model=np.array([[[0.0, 0.0], [0.9, 2.0]], [[0.0, 0.0], [1.0, 0.0]]]),
        gain=np.array([[0.0, 0.0], [-0.3, 0.0]]),
        sensors=("upper_39", "lower_39"),
        scaling=replace(PROGRAM.scaling, pressure_mean=(0.0, 0.0), pressure_std=(1.0, 1.0)),
    )
    y = 0.1 * 0.3 ** np.arange(H)
    found = answer(program, np.array([[0.7, 0.2, 0.0], [0.3, 0.2, 0.0]]))
    np.testing.assert_allclose(found.plan, -0.3 * y)
    np.testing.assert_allclose(found.forces[:, 1], y)
    np.testing.assert_array_equal(found.forces[:, 0], program.scaling.force_mean[0])
    # The history pairs each difference with the action that followed.
    window = np.array([[3.0, 1.0, 5.0, 9.0, 0.01], [2.0, 2.0, 7.0, 4.0, 0.02]])
    np.testing.assert_array_equal(history_of(window), [[2.0, -4.0, 0.02], [0.0, 3.0, 0.0]])


def test_committed_actions_come_back_to_the_bit_and_the_rest_answers_them():
    plan = np.linspace(-0.07, 0.07, H)
    free = np.array([0.0, 0.0, 1.0, 1.0, 1.0, 1.0])
    found = answer(plan=plan, free=free)
    np.testing.assert_array_equal(found.plan[:2], plan[1:3])
    # From the state that is predicted for then, a step without delay answers the same.
    window, committed = WINDOW, answer(plan=plan, free=np.zeros(H))
    for k in range(2):
        history = history_of(window)
        history[-1, -1] = committed.plan[k]
        y = np.tensordot(PROGRAM.model, history, axes=2)[:2]
        # The common part of a pair changes nothing.
        row = np.array([0.4 + y[0], 0.4, -0.2 + y[1], -0.2, committed.plan[k]])
        window = np.vstack([window[1:], row])
    np.testing.assert_allclose(answer(window=window).plan[: H - 2], found.plan[2:], atol=1e-12)


def test_the_weights_change_the_cost_and_no_action():
    weights = np.array([0.0, 0.0, 0.0, 0.0, 0.0, 3.0, 0.0, 0.0])
    found = linear_control_step(PROGRAM, WINDOW, np.zeros(H), np.ones(H), weights)
    np.testing.assert_array_equal(found.plan, answer().plan)
    assert found.cost == pytest.approx(3.0 * np.mean(found.plan**2))
    # The mirror image has the opposite plan.
    image = WINDOW[:, [1, 0, 3, 2, 4]] * [1, 1, 1, 1, -1]
    here, there = answer(plan=np.full(H, 0.02)), answer(window=image, plan=np.full(H, -0.02))
    np.testing.assert_allclose(there.plan, -here.plan, atol=1e-15)
    np.testing.assert_allclose(there.forces, here.forces * [1, -1], atol=1e-15)
    assert there.cost == pytest.approx(here.cost)


def test_a_program_that_contradicts_itself_is_refused():
    for change, message in (
        ({"sensors": ("upper_39", "lower_39", "base_0")}, "must be pairs"),
        ({"gain": np.zeros((5, 3))}, "must be"),
        ({"gain": np.ones((4, 3))}, "on the action that it decides: must be 0"),
        ({"model": np.full((3, 4, 3), np.nan)}, "not finite"),
        ({"model": np.ones((3, 1, 3)), "gain": np.zeros((1, 3))}, "at least 2 rows of memory"),
        ({"action_limit": 0.0}, "action_limit = 0.0"),
    ):
        with pytest.raises(ExportError, match=message):
            replace(PROGRAM, **change)
    # Every number is in the hash.
    moved = PROGRAM.model.copy()
    moved[1, 2, 0] += 1e-12
    gain = PROGRAM.gain * 1.0000001
    hashes = {program_sha256(item) for item in (PROGRAM, replace(PROGRAM, model=moved), replace(PROGRAM, gain=gain))}
    assert len(hashes) == 3
