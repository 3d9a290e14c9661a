"""Rounds of recording, under a controller and from the steady wake: what acts, and continuing without a seam."""

import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from contract.config.plant import FlowConfig
from contract.config.tree import Config
from contract.errors import DatasetError, StillwakeError
from contract.recording.dataset import Dataset, read
from tests.wake.conftest import Killed, Oscillator, equal
from wake.recording import recorder
from wake.recording.plans import ControlledRound, EpisodePlan
from wake.recording.recorder import record_round

pytestmark = [pytest.mark.slow, pytest.mark.usefixtures("cheap_plant")]  # records once for every change on disk

LIMIT = FlowConfig().action_limit


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


ROUND = a_round()


def recorded(output: Path, wanted: ControlledRound = ROUND, policy: Any = Integrator, **arguments: Any):
    record_round(output, wanted, Config(), policy, **{"block_steps": 3, **arguments})
    return read(output)


def test_what_acts_is_command_and_exploration_cut_to_the_limit(tmp_path):
    for policy in (Integrator, Eager):
        wanted = a_round(episodes=1, steps=40)
        actions = recorded(tmp_path / f"{policy.gain}.h5", wanted, policy).episodes[0].series["action"]
        plan, plant, sums, expected = wanted.plans(1)[0], Oscillator(), np.zeros(2), []
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


def test_parts_of_another_controller_and_data_of_another_flow_are_refused(tmp_path):
    output = tmp_path / "a.h5"
    recorder.record(output, [EpisodePlan(forcing="none", steps=2, seed=0)], Config())
    other = Config(flow=FlowConfig(substeps=40))
    with pytest.raises(DatasetError, match=r"none_0 was recorded with flow\.substeps = 30; .* have 40"):
        record_round(output, a_round(), other, Integrator)

    def kill_after_a_block(name: str, done: int, total: int) -> None:
        if done:
            raise Killed

    with pytest.raises(Killed):
        recorded(output, progress=kill_after_a_block)
    with pytest.raises(StillwakeError, match=r"unfinished recording with other settings \(plans\)"):
        recorded(output, a_round(bundle_digest="1" * 64))


def test_calls_add_rounds_that_repeat_nothing(tmp_path):
    output = tmp_path / "a.h5"
    recorder.record(output, [EpisodePlan(forcing="training", steps=7, seed=5)], Config())
    begun, one, two = read(output), recorded(output), recorded(output)
    names = ["training_5", "controlled_1_0", "controlled_1_1", "controlled_2_0", "controlled_2_1"]
    assert [episode.name for episode in two.episodes] == names
    assert equal(Dataset(episodes=two.episodes[:1]), begun)
    assert equal(Dataset(episodes=two.episodes[:3]), one)
    actions = np.array([episode.series["action"] for episode in two.episodes[1:]])
    assert len(np.unique(actions, axis=0)) == 4
    facts = {"forcing_signal": "controlled", "round": 2, "episode": 1, "bundle": "none", "exploration": 0.15}
    assert facts.items() <= two.episodes[-1].provenance.items()


def kill_before_operation(monkeypatch: pytest.MonkeyPatch, number: int) -> Callable[[], int]:
    """Be killed before the operation of that number that changes the disk; how many there have been."""
    count = 0

    def watched(original: Callable[..., Any]) -> Callable[..., Any]:
        def call(*arguments: Any, **options: Any) -> Any:
            nonlocal count
            count += 1
            if count == number:
                raise Killed
            return original(*arguments, **options)

        return call

    for owner, name in ((Path, "replace"), (Path, "unlink"), (Path, "mkdir"), (os, "fsync"), (Path, "write_bytes")):
        monkeypatch.setattr(owner, name, watched(getattr(owner, name)))
    return lambda: count


def test_it_may_be_killed_before_any_change_on_disk_and_continues_without_a_seam(tmp_path):
    wanted = a_round(episodes=1, steps=8)
    whole = recorded(tmp_path / "whole.h5", wanted)
    number, killed = 1, True
    while killed:
        output = tmp_path / f"{number}.h5"
        with pytest.MonkeyPatch.context() as patch:
            operations = kill_before_operation(patch, number)
            killed = False
            try:
                recorded(output, wanted)
            except Killed:
                killed = True
        assert not killed or operations() >= number
        found = read(output) if output.exists() else recorded(output, wanted)
        assert equal(found, whole), f"killed before operation {number}"
        number += 1
    assert number > 20
