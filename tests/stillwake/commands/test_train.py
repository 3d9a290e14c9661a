"""`train` and `record` that are stopped, that go on, and that have nothing to do."""

import hashlib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from contract.config.loading import training
from tests.stillwake.test_stops import SMALL
from train.fitting import unfinished
from train.fitting.progress import Phase
from train.fitting.unfinished import Identity, Reached


@pytest.fixture
def called(monkeypatch: pytest.MonkeyPatch) -> list[dict[str, Any]]:
    """Every training is stopped as soon as it begins, and what it was called with is kept."""
    import train.pipeline

    calls: list[dict[str, Any]] = []

    def stopped(dataset: Path, config: object, output: Path, **options: Any) -> None:
        calls.append(options)
        raise KeyboardInterrupt

    monkeypatch.setattr(train.pipeline, "train_all", stopped)
    return calls


@pytest.fixture
def stopped(tmp_path: Path, short_recording: Path) -> Path:
    """The output of a training with the default settings that was stopped after a checkpoint."""
    output = tmp_path / "model"
    identity = Identity.of(training(), hashlib.sha256(short_recording.read_bytes()).hexdigest(), "cpu", None)
    folder = unfinished.folder_of(output)
    unfinished.note(folder, identity, Reached(phase=Phase.FIT, step=300, total=4000))
    (folder / "fit.pt").write_bytes(b"")
    return output


@pytest.fixture
def same(short_recording: Path) -> list[Any]:
    """What every call names: a recording that is short to read."""
    return ["--dataset", short_recording]


def flat(text: str) -> str:
    return " ".join(text.split())


@pytest.mark.slow  # loads torch
def test_a_stopped_training_says_how_to_go_on_and_another_is_refused_or_starts_over(
    cli: Callable[..., Any], refused: Callable[..., str], called: list[dict[str, Any]], stopped: Path, same: list[Any]
) -> None:
    before = sorted(stopped.parent.iterdir())
    outcome = cli("train", stopped.with_name("new"), *same)
    line = "stopped; the same command continues from the beginning: there is no checkpoint yet\n"
    assert (outcome.code, outcome.err) == (130, line)
    assert sorted(stopped.parent.iterdir()) == before
    outcome = cli("train", stopped, *same)
    assert "model.checkpoints: joint fit, iteration 300 of 4000" in flat(outcome.out)
    assert outcome.err == "stopped; the same command continues from joint fit, iteration 300 of 4000\n"
    other = ("train", stopped, *same, "--set", "train.seed=5")
    line = "holds an unfinished training with train.seed = 0, not 5: finish it with these settings, or start over"
    assert line in refused(*other)
    assert cli(*other, "--restart").code == 130
    assert [options["resume"] for options in called] == [True, True, False]


def test_a_recording_that_is_whole_says_so(
    cli: Callable[..., Any], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from wake.recording import recorder

    (tmp_path / "a.h5").write_bytes(b"whole")
    seen: dict[str, Any] = {}

    def record(output: Path, plans: object, config: object, **options: Any) -> bool:
        seen.update(options)
        return False

    monkeypatch.setattr(recorder, "record", record)
    outcome = cli("record", tmp_path / "a.h5", "training=20", "--state", "s.npz")
    assert (outcome.code, outcome.err) == (0, "")
    assert f"already complete, nothing to record: {tmp_path / 'a.h5'}: 2020 control steps" in flat(outcome.out)
    assert (seen["start"], seen["overwrite"]) == (Path("s.npz"), False)


@pytest.mark.slow  # with the real fit
def test_a_training_that_diverges_is_one_line(refused: Callable[..., str], tmp_path: Path, same: list[Any]) -> None:
    line = refused("train", tmp_path / "model", *same, *SMALL, "--set", "train.learning_rate=1e12")
    assert line.startswith("error: joint fit: the loss is not finite after ")
