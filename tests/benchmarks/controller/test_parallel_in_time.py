"""Sweeps over the horizon: what is known of them, and that the timed graphs compute what is counted."""

import numpy as np
import onnxruntime
import pytest

from benchmarks.controller import parallel_in_time as parallel
from contract.config.controller import MpcConfig
from contract.config.learning import ModelConfig
from export.program.random_program import random_program
from export.reference.model import step
from export.reference.mpc import rollout

HORIZON, LATENT = 6, 3
SMALL = ModelConfig(window=5, latent=LATENT, lstm_width=4, dynamics_width=10, decoder_width=8)


@pytest.fixture
def program():
    return random_program(0, model=SMALL, mpc=MpcConfig(horizon=HORIZON, iterations=2))


@pytest.fixture
def rng():
    return np.random.default_rng(0)


def test_jacobians_are_the_slopes_of_a_step(program, rng):
    plan = rng.normal(0.0, 0.05, (2, HORIZON))
    latents = rollout(program, rng.normal(size=(2, LATENT)), plan)
    found = parallel.jacobians(program, latents, plan)
    for j in range(LATENT):
        h = 1e-6 * np.eye(LATENT)[j]
        ahead, behind = (step(program, latents[:, :-1] + shift, plan) for shift in (h, -h))
        # A central difference of a smooth function: h^2 of truncation and 1e-16 / h of rounding.
        np.testing.assert_allclose(found[..., j], (ahead - behind) / 2e-6, atol=1e-8)


def test_each_sweep_makes_one_more_step_exact_whatever_the_jacobians(program, rng):
    plan = rng.normal(0.0, 0.05, HORIZON)
    exact = rollout(program, rng.normal(size=LATENT), plan)
    latents = np.concatenate([exact[:1], rng.normal(size=(HORIZON, LATENT))])
    wild = rng.normal(size=(HORIZON, LATENT, LATENT))
    for done in range(1, HORIZON + 1):
        latents = parallel.sweep(program, latents, plan, wild)
        np.testing.assert_allclose(latents[: done + 1], exact[: done + 1], atol=1e-9)
    assert np.abs(exact[1:] - exact[0]).max() > 1e-3


def test_renewed_jacobians_square_the_error_and_kept_ones_do_not(program, rng):
    z, plan = rng.normal(size=(4, LATENT)), rng.normal(0.0, 0.05, (4, HORIZON))
    rows = {row["jacobian"]: row for row in parallel.convergence(program, z, [plan, plan + 0.002])}
    newton, kept = (rows[name]["largest"] for name in ("of every sweep", "of the first iterate"))
    assert newton[0] == kept[0] > 1e-4
    assert newton[3] < 1e-13
    assert kept[2] > newton[2]
    assert rows["identity"]["sweeps"] is None or rows["identity"]["sweeps"] > rows["of every sweep"]["sweeps"]


def test_the_timed_graphs_compute_a_rollout_and_a_sweep(program, rng):
    made = {name: onnxruntime.InferenceSession(model) for name, model in parallel.graphs(program).items()}
    z, plan = rng.normal(size=LATENT), rng.normal(0.0, 0.05, HORIZON)
    exact = rollout(program, z, plan)
    old = rollout(program, z, 0.5 * plan)
    jacobian = parallel.jacobians(program, old, 0.5 * plan)
    expected = parallel.sweep(program, old, plan, jacobian)

    def run(name: str, **feeds: np.ndarray) -> np.ndarray:
        (found,) = made[name].run(None, {key: value.astype(np.float32) for key, value in feeds.items()})
        return np.asarray(found)

    # float32 against float64 over a horizon of six.
    np.testing.assert_allclose(run("rollout", z=z[None], plan=plan[None]), exact[1:], atol=1e-5)
    states = {"before": old[:-1], "after": old[1:], "actions": plan[:, None]}
    np.testing.assert_allclose(run("sweep", **states, jacobian=jacobian), expected[1:], atol=1e-5)
    residuals = step(program, old[:-1], plan) - old[1:]
    np.testing.assert_allclose(run("evaluation", **states), residuals, atol=1e-5)


def test_the_bound_is_of_the_roll_outs_behind_the_first():
    # Four of five roll-outs of 100 us, each replaced by one of 25: 300 of 1000 us less.
    of = {"step": 1000.0, "rollout": 100.0, "evaluation": 25.0}
    assert parallel.most_times_faster(of, iterations=4) == pytest.approx(1000.0 / 700.0)
