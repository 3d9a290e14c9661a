"""A student reproduces the teacher's latents when its sensors hold them, and narrow dynamics and decoder its roll-outs.
Held-out figures are those of direct formulas on networks whose answers are known. Lessons hold the teacher's own
answers, and half of their plans go down its cost; the slope along a plan is that of the controller's reference."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
import torch
from torch import Tensor, nn

from contract.config.controller import CostWeights, MpcConfig
from contract.config.learning import ModelConfig
from contract.config.tree import Config
from contract.errors import DatasetError
from contract.release.manifest import Scaling
from examples.random_programs import random_program
from export.program.controller_program import ControllerProgram
from export.program.weights import DecoderWeights, DynamicsWeights
from export.reference.mpc import cost_terms, gradient
from train.distillation.distil import distil, encode_all
from train.distillation.evaluate import evaluate, latent_error, rollout_starts
from train.distillation.lessons import Lessons, distil_predictor, force_slope, plan_slope, predict, teach
from train.fitting.fit import fit_joint, seeded
from train.networks.model import Predictor, WakeModel
from train.networks.samples import Rows, fit_scaling, prepare


def test_encode_all_is_the_encoder_window_by_window(small_recording, small_config):
    episodes = small_recording.with_role("train")
    rows = prepare(episodes, fit_scaling(episodes), mirrored=False)
    encoder = WakeModel(90, small_config.model).encoder
    latents = encode_all(encoder, rows)
    window = small_config.model.window
    assert latents.shape == (400, small_config.model.latent)
    for span in rows.spans():
        assert bool(latents[span.start : span.start + window - 1].isnan().all())
        for end in (span.start + window - 1, span.stop - 1):
            expected = encoder(rows.inputs[None, end - window + 1 : end + 1])[0]
            torch.testing.assert_close(latents[end], expected, rtol=1e-4, atol=1e-5)
    assert int(latents[:, 0].isnan().sum()) == 2 * (window - 1)


@pytest.fixture
def prepared(foreign_recording) -> tuple[Rows, Rows, Scaling]:
    """Rows to learn from and to judge on."""
    layout, training = foreign_recording.layout, foreign_recording.with_role("train")[:2]
    scaling = fit_scaling(training, layout)
    rows, test = (
        prepare(episodes, scaling, mirrored=False, layout=layout)
        for episodes in (training, foreign_recording.with_role("test"))
    )
    return rows, test, scaling


@pytest.mark.slow  # trains
def test_the_student_follows_a_frozen_teacher(prepared, small_config):
    rows, test, _ = prepared
    config = replace(small_config, train=replace(small_config.train, stream_epochs=40.0, distil_epochs=20.0))
    with seeded(5, torch.device("cpu")):
        teacher = WakeModel(7, config.model).encoder
    before = [parameter.clone() for parameter in teacher.parameters()]
    chosen = np.array([0, 2, 4, 5])
    slim = distil(teacher, rows, chosen, config)
    assert slim.lstm.input_size == 5
    assert all(torch.equal(a, b) for a, b in zip(before, teacher.parameters(), strict=True))
    error = latent_error(encode_all(slim, test.with_sensors(chosen)), encode_all(teacher, test))
    # measured 0.07; a student that gives the mean scores 0.86
    assert error < 0.25
    assert latent_error(encode_all(teacher, test), encode_all(teacher, test)) == 0.0


@pytest.mark.proofs  # trains for some seconds; test_distil.py stays
@pytest.mark.slow
def test_the_student_rolls_out_as_the_teacher(prepared, small_config):
    rows, test, scaling = prepared
    teacher = fit_joint(rows, replace(small_config, train=replace(small_config.train, epochs=20.0)))
    config = replace(
        small_config,
        model=replace(small_config.model, slim_dynamics_width=24, slim_decoder_width=16),
        train=replace(small_config.train, predictor_lessons=2048, predictor_epochs=2.5),
        mpc=replace(small_config.mpc, horizon=10),
    )
    before = [parameter.clone() for parameter in teacher.parameters()]
    latents = encode_all(teacher.encoder, rows)
    lessons = teach(teacher, latents, rows, scaling, config)
    student = distil_predictor(lessons, config.model, config.train)
    assert all(torch.equal(a, b) for a, b in zip(before, teacher.parameters(), strict=True))
    assert (student.dynamics.hidden.in_features, student.decoder.input.out_features) == (24, 16)

    starts = rollout_starts(test, config.model.window, config.mpc.horizon)
    latent = encode_all(teacher.encoder, test)[starts]
    # The held-out actions, in an order that never met these starts.
    elsewhere = starts[torch.randperm(len(starts), generator=torch.Generator().manual_seed(3))]
    actions = test.actions[elsewhere[:, None] + torch.arange(config.mpc.horizon)]

    def error(model: Predictor) -> float:
        with torch.no_grad():
            forces = teacher.decoder(teacher.dynamics.rollout(latent, actions))
            found = model.decoder(model.dynamics.rollout(latent, actions))
            return ((found - forces).abs().mean() / forces.std()).item()

    torch.manual_seed(0)
    untrained = error(Predictor(config.model.slim))
    assert untrained > 0.6
    assert error(student) < 0.25


WINDOW = 4


class LastRow(nn.Module):
    """Latents are the window's last row plus a bias."""

    def __init__(self, bias: float) -> None:
        super().__init__()
        self.window, self.bias = WINDOW, bias
        self.output = nn.Linear(1, 2)

    def encode_segments(self, segments: Tensor) -> Tensor:
        return segments[:, WINDOW - 1 :, :2] + self.bias


class Add(nn.Module):
    """z' = z + a in both dimensions."""

    def rollout(self, latent: Tensor, actions: Tensor) -> Tensor:
        return torch.stack([latent + total[:, None] for total in actions.cumsum(dim=1).T])


def make_rows(lengths: tuple[int, ...]) -> Rows:
    """Forces equal the rows' first two columns, which are the running sum of the actions."""
    generator = torch.Generator().manual_seed(0)
    actions = torch.randn(sum(lengths), generator=generator)
    walk = torch.cat([torch.tensor([0.0]), actions.cumsum(0)[:-1]])
    forces = torch.stack([walk, walk], dim=1)
    inputs = torch.cat([forces, actions[:, None]], dim=1)
    return Rows(inputs=inputs, actions=actions, forces=forces, lengths=lengths, unit=torch.ones(2))


def run(rows: Rows, bias: float = 0.0, horizons: tuple[int, ...] = (2, 5)):
    return evaluate(LastRow(bias), SimpleNamespace(dynamics=Add(), decoder=nn.Identity()), rows, horizons=horizons)  # type: ignore[arg-type]


def test_errors_are_those_of_the_formula():
    for item in run(make_rows((40, 30))).rollout:
        assert max(item.latent, item.drag, item.lift) < 1e-5
    rows, bias = make_rows((40, 30)), 0.3
    metrics = run(rows, bias)
    seen = np.concatenate([rows.forces[WINDOW - 1 : 40, 0], rows.forces[40 + WINDOW - 1 :, 0]]).astype(float)
    assert metrics.drag.r2 == pytest.approx(1 - bias**2 / seen.var(), rel=1e-5)
    assert metrics.drag.l1_over_sigma == pytest.approx(bias / seen.std(), rel=1e-5)
    for item in metrics.rollout:
        # The offset is carried along; against the encoder's own later latents it cancels.
        assert item.lift == pytest.approx(bias / seen.std(), rel=1e-4)
        assert item.latent == pytest.approx(0.0, abs=1e-5)
    assert [item.horizon for item in metrics.rollout] == [2, 5]


def test_short_and_constant_test_episodes_are_refused():
    with pytest.raises(DatasetError, match="a window of 4 and 5 steps ahead"):
        run(make_rows((8, 8)))
    rows = make_rows((40,))
    with pytest.raises(DatasetError, match="constant"):
        run(replace(rows, forces=torch.zeros(40, 2)))


@pytest.fixture(scope="module")
def taught(small_recording, small_config) -> tuple[WakeModel, Rows, Scaling, Config, Lessons]:
    episodes = small_recording.episodes[:1]
    scaling = fit_scaling(episodes)
    rows = prepare(episodes, scaling, mirrored=True)
    train, mpc = replace(small_config.train, predictor_lessons=1000), replace(small_config.mpc, horizon=6)
    config = replace(small_config, train=train, mpc=mpc)
    torch.manual_seed(0)
    teacher = WakeModel(rows.sensors, config.model).eval()
    return teacher, rows, scaling, config, teach(teacher, encode_all(teacher.encoder, rows), rows, scaling, config)


def test_lessons_are_the_teachers_and_their_plans_go_down_its_cost(taught):
    teacher, _, scaling, config, lessons = taught
    assert len(lessons) >= 1000
    some = lessons.drawn(torch.tensor([0, 17, 999]))
    with torch.no_grad():
        ahead = teacher.dynamics.rollout(some.latents[:, 0], some.actions).transpose(0, 1)
        assert torch.allclose(some.latents[:, 1:], ahead, atol=1e-5)  # float32, in other batches
        assert torch.allclose(some.forces, teacher.decoder(some.latents), atol=1e-5)
    # Plans on their way cost less step by step and stay within the limit.
    forces = lessons.forces[:, 1:].numpy() * scaling.force_std + scaling.force_mean
    cost = cost_terms(forces, 0.0 * forces[..., 0], 0.0, 0.0) @ config.mpc.weights.as_tuple()
    # Batches take turns: a plan's step, then lessons of recorded actions.
    way = cost[: len(cost) // 32 * 32].reshape(-1, 2, 256)[:16, 0].mean(1)
    assert way[-1] < way[0]
    assert lessons.actions.abs().max() * scaling.action_std <= config.flow.action_limit * (1.0 + 1e-6)


MODEL = ModelConfig(dynamics_width=12, decoder_width=10, latent=3, dropout=0.0)
# The terms in the plan alone are no part of what networks are taught.
WEIGHTS = CostWeights(lift=0.2, lift_mean=0.7, smoothness=0.0)
HORIZON = 9


def _with_program() -> tuple[Predictor, ControllerProgram]:
    program = random_program(3, model=MODEL, mpc=MpcConfig(horizon=HORIZON, weights=WEIGHTS))
    torch.manual_seed(0)
    predictor = Predictor(MODEL).double()
    dynamics, decoder = (
        {name: value.numpy() for name, value in part.state_dict().items()}
        for part in (predictor.dynamics, predictor.decoder)
    )
    return predictor, replace(
        program, dynamics=DynamicsWeights.from_state(dynamics), decoder=DecoderWeights.from_state(decoder)
    )


def test_the_slope_is_the_reference_adjoints():
    predictor, program = _with_program()
    generator = np.random.default_rng(1)
    z = generator.standard_normal((4, 3))
    plans = generator.uniform(-0.07, 0.07, (4, HORIZON))
    actions = torch.tensor(plans / program.scaling.action_std).requires_grad_(True)
    _, forces = predict(predictor, torch.tensor(z), actions)
    by_force = force_slope(forces[1:], WEIGHTS, program.scaling)
    slope = plan_slope(forces, actions, by_force)
    expected = gradient(program, z, plans, 0.0)
    # Float64 on both sides; the two differ in the order of sums.
    assert np.allclose(slope.numpy() / program.scaling.action_std, expected, rtol=1e-9, atol=1e-12)


def test_the_slope_is_differentiable_by_the_weights():
    predictor, _ = _with_program()
    weight = predictor.dynamics.output.weight
    actions = torch.linspace(-1.0, 1.0, HORIZON, dtype=torch.float64)[None].requires_grad_(True)
    latent = torch.ones(1, 3, dtype=torch.float64)
    by_force = torch.ones(HORIZON, 1, 2, dtype=torch.float64)

    def first_slope(*, differentiable: bool) -> torch.Tensor:
        _, forces = predict(predictor, latent, actions)
        return plan_slope(forces, actions, by_force, differentiable=differentiable)[0, 0]

    (found,) = torch.autograd.grad(first_slope(differentiable=True), weight)
    step, values = 1e-6, []
    for moved in (step, -2.0 * step):
        with torch.no_grad():
            weight[0, 0] += moved
        values.append(first_slope(differentiable=False).item())
    # Central difference: its own error is near 1e-10 here.
    assert abs((values[0] - values[1]) / (2.0 * step) - found[0, 0].item()) < 1e-7
