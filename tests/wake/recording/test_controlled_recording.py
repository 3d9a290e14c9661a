"""Recording under a controller: the exploration, what the controller is told, rounds, and continuing without a seam."""

from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from contract.config.plant import FlowConfig, ForcingConfig
from contract.config.tree import Config
from contract.errors import DatasetError, StillwakeError
from contract.recording.dataset import Dataset, read
from contract.release.bundle import load
from ecu.bundle_policy import BundlePolicy
from tests.wake.recording.killing import Killed, equal
from wake.recording import recorder
from wake.recording.episode_job import Policy
from wake.recording.episode_plan import EpisodePlan, exploration
from wake.recording.recorder import record_round
from wake.recording.round_plan import CalmRound, ControlledRound

pytestmark = pytest.mark.slow  # records episodes under a controller

FLOW = FlowConfig()
LIMIT = FLOW.action_limit


class Integrator:
    """Its command depends on all that it has ever seen."""

    gain = 0.02

    def start(self) -> np.ndarray:
        return np.zeros(2)

    def step(self, memory: np.ndarray, Cp: np.ndarray, action: float) -> tuple[float, np.ndarray]:
        memory = 0.95 * memory + (Cp[17], action)
        return self.gain * float(memory[0] + memory[1]), memory


class Eager(Integrator):
    gain = 10.0


def a_round(**changes: Any) -> ControlledRound:
    return ControlledRound(**{"episodes": 2, "steps": 8, "bundle": "none", "bundle_digest": "0" * 64, **changes})


def recorded(
    output: Path, wanted: ControlledRound | None = None, policy: Callable[[], Policy] = Integrator, **arguments: Any
) -> Dataset:
    wanted = a_round() if wanted is None else wanted
    record_round(output, wanted, Config(), policy, **{"block_steps": 3, **arguments})
    return read(output)


def test_exploration_has_the_variance_and_the_memory_it_should():
    for time in [0.4, 1.0, 3.0]:
        n, rms = 400_000, 0.15
        x = exploration(n, ForcingConfig(exploration_time=time), FLOW, np.random.default_rng(3), rms=rms) / LIMIT
        # Independent samples that tell as much: n (1 - r^2) / (1 + r^2), 27,000 at least; four standard errors.
        r = np.exp(-0.2 / time)
        few = n * (1 - r**2) / (1 + r**2)
        assert x.mean() == pytest.approx(0.0, abs=4 * rms * np.sqrt((1 + r) / (1 - r) / n))
        assert x.std() == pytest.approx(rms, rel=4 / np.sqrt(2 * few))
        for lag in (1, 2, 5, 10):
            # Of an Ornstein-Uhlenbeck process: exp(-lag / time).
            assert np.corrcoef(x[:-lag], x[lag:])[0, 1] == pytest.approx(
                np.exp(-0.2 * lag / time), abs=4 / np.sqrt(few)
            )
        # Gaussian: 4.55 % beyond two standard deviations.
        assert np.mean(np.abs(x) > 2 * rms) == pytest.approx(0.0455, abs=4 * np.sqrt(0.0455 / few))
    runs = np.array([exploration(4, ForcingConfig(), FLOW, np.random.default_rng(i), rms=0.5) for i in range(3000)])
    # Four standard errors of a standard deviation from 3000 values.
    assert runs.std(axis=0) / LIMIT == pytest.approx(np.full(4, 0.5), rel=4 / np.sqrt(6000))


def test_no_two_episodes_are_disturbed_alike():
    kinds: list[tuple[Any, str]] = [(a_round, "controlled"), (CalmRound, "calm")]
    for kind, own in kinds:
        wanted = [kind(), kind(seed=2), kind(role=own)]
        plans = [plan for item in wanted for number in (1, 2) for plan in item.plans(number)]
        signals = np.array([plan.signal(Config())[:8] for plan in plans])
        signals /= np.linalg.norm(signals, axis=1, keepdims=True)
        assert len(np.unique(signals.round(9), axis=0)) == len(plans), own
    # Every control step of a shedding cycle once.
    assert sorted(plan.lead for plan in a_round(episodes=24).plans(1)) == list(range(24))


@pytest.mark.usefixtures("cheap_plant")
class TestOnACheapPlant:
    def test_what_acts_is_command_and_exploration_cut_to_the_limit(self, tmp_path, oscillator):
        for policy in (Integrator, Eager):
            wanted = a_round(episodes=1, steps=40)
            actions = recorded(tmp_path / f"{policy.gain}.h5", wanted, policy).episodes[0].series["action"]
            plan, plant, sums, expected = wanted.plans(1)[0], oscillator(), np.zeros(2), []
            for _ in range(plan.lead):
                plant.advance(0.0)
            for noise in plan.signal(Config()):
                sample = plant.sample()
                sums = 0.95 * sums + (sample.Cp[17], sample.action)
                expected.append(min(max(policy.gain * sums.sum() + noise, -LIMIT), LIMIT))
                plant.advance(expected[-1])
            assert actions.tolist() == expected
        # The last one saturates, and never beyond the limit.
        assert np.abs(actions).max() == LIMIT and np.mean(np.abs(actions) == LIMIT) > 0.5

    def test_parts_of_another_controller_and_data_of_another_flow_are_refused(self, tmp_path):
        output = tmp_path / "a.h5"
        recorder.record(output, [EpisodePlan(forcing="none", steps=2, seed=0)], Config())
        other = Config(flow=FlowConfig(substeps=40))
        with pytest.raises(DatasetError, match=r"none_0 was recorded with flow\.substeps = 30, .* have 40"):
            record_round(output, a_round(), other, Integrator)
        with pytest.raises(Killed):
            recorded(output, progress=_kill_after_a_block)
        with pytest.raises(StillwakeError, match=r"unfinished recording with other settings \(plans\)"):
            recorded(output, a_round(bundle_digest="1" * 64))

    def test_a_second_call_adds_a_round_that_repeats_nothing(self, tmp_path):
        output = tmp_path / "a.h5"
        recorder.record(output, [EpisodePlan(forcing="training", steps=7, seed=5)], Config())
        begun = read(output)
        one = recorded(output)
        two = recorded(output)
        names = ["training_5", "controlled_1_0", "controlled_1_1", "controlled_2_0", "controlled_2_1"]
        assert [episode.name for episode in two.episodes] == names
        assert equal(Dataset(episodes=two.episodes[:1]), begun)
        assert equal(Dataset(episodes=two.episodes[:3]), one)
        actions = np.array([episode.series["action"] for episode in two.episodes[1:]])
        assert len(np.unique(actions, axis=0)) == 4
        facts = {"forcing_signal": "controlled", "round": 2, "episode": 1, "bundle": "none", "exploration": 0.15}
        assert facts.items() <= two.episodes[-1].provenance.items()

    def test_a_stopped_recording_continues_without_a_seam(self, tmp_path, short_release):
        # The controller's window takes four steps to fill: its plan is stopped as it goes on, too.
        wanted = a_round(steps=12)
        arguments: dict[str, Any] = {"policy": partial(BundlePolicy, load(short_release)), "block_steps": 3}
        whole = recorded(tmp_path / "whole.h5", wanted, **arguments)
        calls = 0

        def stop(name: str, steps: int, total: int) -> None:
            nonlocal calls
            calls += 1
            # The first two calls announce the episodes.
            if calls > 2:
                calls = 0
                raise Killed

        stopped = tmp_path / "stopped.h5"
        stops = 0
        while not stopped.exists():
            try:
                recorded(stopped, wanted, progress=stop, **arguments)
            except Killed:
                stops += 1
        assert stops >= 6
        assert equal(read(stopped), whole)


def _kill_after_a_block(name: str, done: int, total: int) -> None:
    if done:
        raise Killed
