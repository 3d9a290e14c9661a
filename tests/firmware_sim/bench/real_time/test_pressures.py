"""A recording as a flow in real time."""

import numpy as np
import pytest

from contract.errors import ConfigError, DatasetError
from contract.recording.dataset import Dataset
from contract.recording.episode import Episode
from contract.sensors import COUNT
from firmware_sim.bench.real_time.pressures import Replay


def episode(name: str, role: str, steps: int, base: float) -> Episode:
    t = 0.2 * np.arange(steps)
    cp = base + np.arange(steps)[:, None] + 0.001 * np.arange(COUNT)
    series = {"t": t, "action": 0.0 * t, "Cp": cp, "Cd": t, "Cl": t}
    return Episode(name=name, role=role, series=series, initial_action=0.0, provenance={})


@pytest.fixture
def recorded() -> Dataset:
    return Dataset(episodes=(episode("round", "controlled", 9, 900.0), episode("sine", "train", 4, 100.0)))


def test_rows_come_one_a_period_and_begin_again(recorded) -> None:
    flow = Replay(recorded, "sine", 2)
    first = [float(flow.sampled()[0]) for _ in range(7)]
    assert first == [102.0, 103.0, 100.0, 101.0, 102.0, 103.0, 100.0]
    assert flow.rounds == 2
    assert flow.sampled()[5] == pytest.approx(101.005)


def test_the_jets_change_nothing(recorded) -> None:
    one, other = Replay(recorded), Replay(recorded)
    for _ in range(6):
        assert np.array_equal(one.sampled(), other.sampled())
        one.drive(0.07)
    assert "do not answer the jets" in one.description


def test_a_recording_under_a_controller_is_not_taken_unasked(recorded) -> None:
    assert Replay(recorded).sampled()[0] == 100.0
    assert Replay(recorded, "round").sampled()[0] == 900.0
    assert Replay(Dataset(episodes=recorded.episodes[:1])).sampled()[0] == 900.0


def test_what_is_not_there_is_named_with_what_is(recorded) -> None:
    with pytest.raises(DatasetError, match="episode 'chirp': the data set has round, sine"):
        Replay(recorded, "chirp")
    for first in (4, -1):
        with pytest.raises(ConfigError, match=rf"control step {first}: episode sine has 0\.\.3"):
            Replay(recorded, "sine", first)
