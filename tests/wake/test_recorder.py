from pathlib import Path

import numpy as np
import pytest

from contract.config import Config
from contract.dataset import Dataset, read
from contract.errors import StillwakeError
from wake import recorder
from wake.recorder import EpisodePlan, record
from wake.truck_wake import TruckWake

PLANS = [EpisodePlan(forcing="training", steps=7, seed=5), EpisodePlan(forcing="none", steps=2, seed=0)]


class _Killed(BaseException):
    """Stands for a signal: not an Exception, so nothing may swallow it."""


@pytest.fixture(autouse=True)
def small_blocks(monkeypatch: pytest.MonkeyPatch, shared_wake: TruckWake) -> None:
    monkeypatch.setattr(recorder, "BLOCK_STEPS", 3)
    monkeypatch.setattr(recorder, "TruckWake", lambda config: shared_wake)


def _equal(a: Dataset, b: Dataset) -> bool:
    return all(
        np.array_equal(x.series[name], y.series[name])
        for x, y in zip(a.episodes, b.episodes, strict=True)
        for name in x.series
    )


def test_a_stopped_recording_continues_without_a_seam(tmp_path: Path) -> None:
    record(tmp_path / "whole.h5", PLANS, Config())
    stopped = tmp_path / "stopped.h5"

    def stop_after_two_blocks(name: str, done: int, total: int) -> None:
        if done == 6:
            raise _Killed

    with pytest.raises(_Killed):
        record(stopped, PLANS, Config(), stop_after_two_blocks)
    assert not stopped.exists()
    record(stopped, PLANS, Config())
    assert _equal(read(tmp_path / "whole.h5"), read(stopped))
    assert [path.name for path in tmp_path.iterdir()].count("stopped.h5.parts") == 0


def test_samples_follow_the_timing_convention(tmp_path: Path, wake: TruckWake) -> None:
    first = wake.sample()
    record(tmp_path / "a.h5", PLANS, Config())
    episode = read(tmp_path / "a.h5").episodes[0]
    series = episode.series
    assert series["t"] == pytest.approx(0.2 * np.arange(7))
    assert series["Cd"][0] == pytest.approx(first.Cd, rel=1e-6)  # stored in single precision
    # Sample k is taken before a_k acts: the reaction to the jets' momentum still shows a_{k-1}.
    assert series["Cd_momentum"][1:] == pytest.approx(-4 * 1.2 / 0.05 * series["action"][:-1] ** 2, rel=1e-5)
    assert episode.initial_action == 0.0
    assert (episode.role, read(tmp_path / "a.h5").episodes[1].role) == ("train", "train")


def test_parts_of_another_recording_are_refused(tmp_path: Path) -> None:
    parts = tmp_path / "a.h5.parts"
    parts.mkdir()
    (parts / "task.json").write_text("{}")
    with pytest.raises(StillwakeError, match="other settings"):
        record(tmp_path / "a.h5", PLANS, Config())


def test_an_unwritable_place_is_one_clear_error(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(StillwakeError, match="cannot write"):
        record(tmp_path / "file" / "a.h5", PLANS, Config())
