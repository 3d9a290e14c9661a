"""Gradients through the flow against differences of whole runs, also as a training through the flow takes them."""

import copy
from dataclasses import replace

import numpy as np
import pytest

from contract.config.body import BodyConfig
from contract.config.plant import FlowConfig
from contract.differentiable import FlowState, Seen
from contract.errors import PlantError
from contract.ledger import LEDGER_FIELDS
from wake.plant.sample import Sample
from wake.solver.grid import Flow
from wake.truck.tape import DifferentiableWake, Tape, no_weights
from wake.truck.truck_wake import TruckWake

SQUARE = BodyConfig(length=1.0, leading_edge_radius=0.0, sensors_per_side=6, sensors_on_base=4)
SCALARS = (*LEDGER_FIELDS, "Uy_probe", "action")
PERIODS = 6


@pytest.fixture(scope="module")
def plant() -> TruckWake:
    """A square cylinder in a gust, some periods after its start."""
    plant = TruckWake(FlowConfig(reynolds=200.0, substeps=20, refinement=0.4), body=SQUARE)
    plant.flow.flat[:] = plant.solver.start().flat
    plant.wind = lambda t: 0.05 * np.sin(3.0 * t)
    for k in range(5):
        plant.advance(0.03 * (-1) ** k)
    return plant


def weights_of(plant: TruckWake, seed: int) -> list[Sample]:
    rng = np.random.default_rng(seed)
    n = len(plant.layout)
    return [
        replace(no_weights(n), Cp=rng.normal(size=n), **{name: rng.normal() for name in SCALARS})
        for _ in range(PERIODS)
    ]


@pytest.mark.slow  # numba compiles the adjoint
def test_gradients_by_actions_and_start_are_those_of_differences(plant):
    """Of a sum of all that a sample has, at each period with other weights; with memory for one period and for all, and
    actions in double and single precision."""
    start, weights = plant.state(), weights_of(plant, 3)
    actions = np.random.default_rng(4).uniform(-0.05, 0.05, PERIODS).astype(np.float32)
    direction = Flow.zeros(plant.grid.shape)
    for faces, is_open in ((direction.faces_u, plant.boundary.open_u), (direction.faces_v, plant.boundary.open_v)):
        faces[is_open] = np.random.default_rng(5).normal(size=int(is_open.sum()))

    def total(moved: float, along: np.ndarray) -> float:
        plant.reset(start)
        plant.flow.flat[:] += moved * direction.flat
        samples = [plant.advance(action) for action in actions.astype(float) + along]
        return sum(
            w.Cp @ s.Cp + sum(getattr(w, name) * getattr(s, name) for name in SCALARS)
            for w, s in zip(weights, samples, strict=True)
        )

    one_period, slopes = (1 + plant.config.substeps) * start.flat.nbytes / 1e6, list[np.ndarray]()
    for memory_mb in (one_period + PERIODS * start.flat.nbytes / 1e6, 1000.0):
        plant.reset(start)
        tape = Tape(plant, memory_mb)
        for action in actions if memory_mb == 1000.0 else actions.tolist():
            tape.advance(action)
        # A copy has a plant of its own, whatever becomes of this one.
        tape = copy.copy(tape)
        plant.flow.flat[:] = 0.0
        slopes.append(np.array([tape.back(w) for w in reversed(weights)][::-1]))
    assert slopes[0] == pytest.approx(slopes[1], rel=1e-12)
    # The truncation of differences and their rounding, 1e-16 / 1e-5, balance at some 1e-9.
    for k in range(0, PERIODS, 2):
        by = 1e-5 * np.eye(PERIODS)[k]
        assert slopes[0][k] == pytest.approx((total(0.0, by) - total(0.0, -by)) / 2e-5, rel=1e-6)
    slope = (total(1e-6, np.zeros(PERIODS)) - total(-1e-6, np.zeros(PERIODS))) / 2e-6
    assert tape.bar.flat @ direction.flat == pytest.approx(slope, rel=1e-6)
    plant.reset(start)


@pytest.mark.proofs  # numba compiles all kernels once more; the gradients above are those of the same lines
def test_single_precision_has_the_gradients_of_double(plant):
    """Rounding is 6e-8 a number, and a hundred steps leave 1e-5 of the largest slope: ten times that is allowed."""
    single = TruckWake(plant.config, body=SQUARE, precision=np.float32)
    single.wind, start, weights = plant.wind, plant.state(), weights_of(plant, 3)
    found = []
    for each in (plant, single):
        each.reset(start)
        tape = Tape(each)
        samples = [tape.advance(0.05 * (-1) ** k) for k in range(PERIODS)]
        found.append((samples[-1].Cd, [tape.back(w) for w in reversed(weights)]))
        assert tape.bar.flat.dtype == each.flow.flat.dtype
    (drag, slopes), (single_drag, single_slopes) = found
    assert single_drag == pytest.approx(drag, rel=1e-5)
    assert single_slopes == pytest.approx(slopes, abs=1e-4 * np.abs(slopes).max())
    plant.reset(start)


def test_a_tape_ends_before_its_memory_does_and_starts_again(plant):
    start = plant.state()
    tape = Tape(plant, 25 * start.flat.nbytes / 1e6)
    for _ in range(4):
        tape.advance(0.0)
    with pytest.raises(PlantError, match=r"holds 4 periods, and another period .* does not fit into"):
        tape.advance(0.0)
    tape.restart()
    with pytest.raises(PlantError, match="no period is left"):
        tape.back(no_weights(len(plant.layout)))
    tape.advance(0.0)
    tape.back(no_weights(len(plant.layout)))
    with pytest.raises(PlantError, match="not at the end of the tape: call `restart`"):
        tape.advance(0.0)
    plant.reset(start)


SENSORS = ("upper_39", "lower_39", "base_0", "base_9")
ACTIONS = np.array([0.03, -0.02, 0.05, 0.01])


@pytest.mark.slow  # numba compiles the adjoint
def test_slopes_of_all_that_is_seen_are_those_of_differences():
    speeds = np.array([0.8, 0.85, 0.9, 1.0, 1.1])
    plant = TruckWake(FlowConfig(refinement=0.4, substeps=12))
    plant.advance(0.03)
    wake = DifferentiableWake(plant, plant.layout.indices(SENSORS))
    start, rng = FlowState(flat=plant.flow.flat.copy(), action=0.03), np.random.default_rng(0)
    weights = [Seen(Cp=rng.normal(size=4), Cd=rng.normal(), Cl=rng.normal(), Uy=rng.normal()) for _ in ACTIONS]

    def value(actions: np.ndarray) -> float:
        total = 0.0
        wake.begin(start, speeds)
        for action, weight in zip(actions, weights, strict=True):
            seen = wake.advance(float(action))
            total += float(weight.Cp @ seen.Cp)
            total += weight.Cd * seen.Cd + weight.Cl * seen.Cl + weight.Uy * seen.Uy
        return total

    value(ACTIONS)
    slopes = [wake.back(weight) for weight in reversed(weights)][::-1]
    for k, slope in enumerate(slopes):
        step = np.where(np.arange(len(ACTIONS)) == k, 1e-5, 0.0)
        # Differences of second order; the flow's own rounding is below that.
        assert slope == pytest.approx((value(ACTIONS + step) - value(ACTIONS - step)) / 2e-5, rel=1e-5)


@pytest.mark.slow
def test_a_wake_at_rest_at_another_speed_is_that_of_another_reynolds_number_in_other_units():
    config, speed = FlowConfig(refinement=0.4, substeps=12), 0.5
    plant = TruckWake(config)
    for action in (0.06, 0.06, 0.0):
        plant.advance(action)
    start = FlowState(flat=plant.flow.flat.copy())
    seen = DifferentiableWake(plant, plant.layout.indices(SENSORS)).at_rest(start, speed, over=1.0)
    slower = TruckWake(replace(config, reynolds=speed * config.reynolds, control_period=speed * config.control_period))
    slower.flow.flat[:] = start.flat
    Cp = np.array([slower.advance(0.0).Cp[slower.layout.indices(SENSORS)] for _ in range(20)])[10:]
    assert seen == pytest.approx((Cp[:, 2:].mean(), np.abs(Cp[:, ::2] - Cp[:, 1::2]).mean()), rel=1e-9)
    assert DifferentiableWake(plant, plant.layout.indices(("upper_39", "lower_39"))).at_rest(start, speed) is None
