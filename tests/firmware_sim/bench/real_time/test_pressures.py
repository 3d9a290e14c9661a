"""A recording as a flow in real time."""

from dataclasses import replace

import numpy as np
import pytest

from contract.errors import DatasetError
from contract.recording.dataset import Dataset
from contract.recording.episode import Episode, Role
from contract.sensors import COUNT
from firmware_sim.bench.real_time.pressures import Replay


def episode(name: str, role: Role, steps: int, base: float) -> Episode:
    t = 0.2 * np.arange(steps)
    cp = base + np.arange(steps)[:, None] + 0.001 * np.arange(COUNT)
    series = {"t": t, "action": 0.0 * t, "Cp": cp, "Cd": t, "Cl": t}
    return Episode(name=name, role=role, series=series, initial_action=0.0, provenance={})


def test_rows_come_one_a_period_and_begin_again_whatever_the_jets_do() -> None:
    recorded = Dataset(episodes=(episode("round", "controlled", 9, 900.0), episode("sine", "train", 4, 100.0)))
    flow, rows = Replay(recorded, "sine"), []
    for _ in range(9):
        rows.append(flow.sampled())
        flow.drive(0.07)
    assert [row[0] for row in rows] == [*2 * [100.0, 101.0, 102.0, 103.0], 100.0]
    assert rows[0][5] == pytest.approx(100.005)
    assert flow.rounds == 2
    # A recording under a controller is not taken unasked.
    assert Replay(recorded).sampled()[0] == 100.0
    assert Replay(recorded, "round").sampled()[0] == 900.0
    assert Replay(Dataset(episodes=recorded.episodes[:1])).sampled()[0] == 900.0
    # Nor a forced one, where the jets were at rest in another.
    forced = replace(recorded.episodes[1], series={**recorded.episodes[1].series, "action": np.ones(4)})
    assert Replay(Dataset(episodes=(forced, episode("none", "train", 4, 300.0)))).sampled()[0] == 300.0
    with pytest.raises(DatasetError, match="episode 'chirp': the data set has round, sine"):
        Replay(recorded, "chirp")
