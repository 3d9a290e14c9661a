"""Recording from the steady wake: its random actions, rounds, and what the data set says of them."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from contract.config.tree import Config
from contract.errors import ConfigError
from contract.recording.dataset import Dataset, read
from wake.recording.recorder import record_round
from wake.recording.round_plan import CalmRound, ControlledRound
from wake.solver.grid import box_grid
from wake.truck.state import Origin, State, save_state

START = np.array([0.3, -0.1])


@pytest.fixture
def start(tmp_path) -> Path:
    """A state of the cheap plant, in a file as the steady wake's."""
    path = tmp_path / "start" / "steady.npz"
    path.parent.mkdir()
    config = Config()
    origin = Origin(shape=box_grid(config.body.length, 1.0).shape, reynolds=config.flow.reynolds)
    save_state(path, State(flat=START, substep=0, action=0.0, origin=origin))
    return path


def recorded(output: Path, start: Path, wanted: CalmRound, **arguments: Any) -> Dataset:
    record_round(output, wanted, Config(), start=start, **{"block_steps": 3, **arguments})
    return read(output)


def test_the_random_actions_have_the_amplitudes_asked_for():
    plans = CalmRound(episodes=4, steps=100_000, smallest=0.001, largest=0.008).plans(1)
    rms = [np.sqrt(np.mean(plan.signal(Config()) ** 2)) for plan in plans]
    # A correlation time of five steps leaves some 20,000 independent values: four standard errors of a deviation.
    assert rms == pytest.approx([0.001, 0.002, 0.004, 0.008], rel=4 / np.sqrt(2 * 20_000))


def test_what_makes_no_sense_is_refused_by_name():
    with pytest.raises(ConfigError, match="role = 'test': must be one of train, calm"):
        CalmRound(role="test")  # type: ignore[arg-type]  # a role of no round


@pytest.mark.usefixtures("cheap_plant")
class TestOnACheapPlant:
    def test_episodes_begin_in_the_file_and_are_driven_by_the_signal(self, tmp_path, start, oscillator):
        wanted = CalmRound(episodes=2, steps=7)
        for plan, episode in zip(wanted.plans(1), recorded(tmp_path / "a.h5", start, wanted).episodes, strict=True):
            plant, expected = oscillator(), []
            plant.reset(State(flat=START, substep=0, action=0.0))
            for action in plan.signal(Config()):
                expected.append(plant.sample().Cd)
                plant.advance(action)
            assert np.array_equal(episode.series["action"], plan.signal(Config()))
            # Stored in 16 bits.
            assert episode.series["Cd"] == pytest.approx(expected, abs=2**-15)
            assert episode.initial_action == 0.0
            assert episode.provenance["amplitude"] == plan.level
            assert episode.provenance["start"] == "steady.npz"

    def test_rounds_of_both_kinds_count_on_in_one_file(self, tmp_path, start):
        output, wanted = tmp_path / "a.h5", CalmRound(episodes=1, steps=3)
        recorded(output, start, wanted)
        controlled = ControlledRound(episodes=1, steps=3, bundle="none", bundle_digest="0" * 64)
        record_round(output, controlled, Config())
        names = [episode.name for episode in recorded(output, start, wanted).episodes]
        assert names == ["calm_1_0", "controlled_2_0", "calm_3_0"]
