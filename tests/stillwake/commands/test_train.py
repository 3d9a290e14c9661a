"""`train` that is stopped, that goes on, and that fails."""

import hashlib

import pytest

from contract.config.loading import training
from tests.stillwake.test_stops import SMALL
from train.fitting import unfinished
from train.fitting.progress import Phase
from train.fitting.unfinished import Identity, Reached


@pytest.fixture
def called(monkeypatch):
    """Every training is stopped as soon as it begins, and what it was called with is kept."""
    import train.pipeline

    calls = list[dict[str, object]]()

    def stopped(dataset, config, output, **options):
        calls.append(options)
        raise KeyboardInterrupt

    monkeypatch.setattr(train.pipeline, "train_all", stopped)
    return calls


@pytest.fixture
def stopped(tmp_path, short_recording):
    """The output of a training with the default settings that was stopped after a checkpoint."""
    output = tmp_path / "model"
    identity = Identity.of(training(), hashlib.sha256(short_recording.read_bytes()).hexdigest(), "cpu", None)
    folder = unfinished.folder_of(output)
    unfinished.note(folder, identity, Reached(phase=Phase.FIT, step=300, total=4000))
    (folder / "fit.pt").write_bytes(b"")
    return output


@pytest.mark.slow  # loads torch
def test_a_stopped_training_says_how_to_go_on_and_another_must_restart(cli, refused, called, stopped, short_recording):
    before = sorted(stopped.parent.iterdir())
    outcome = cli("train", stopped.with_name("new"), "--dataset", short_recording)
    line = "stopped; the same command continues from the beginning: there is no checkpoint yet\n"
    assert (outcome.code, outcome.err) == (130, line)
    assert sorted(stopped.parent.iterdir()) == before
    outcome = cli("train", stopped, "--dataset", short_recording)
    assert "model.checkpoints: joint fit, iteration 300 of 4000" in " ".join(outcome.out.split())
    assert outcome.err == "stopped; the same command continues from joint fit, iteration 300 of 4000\n"
    other = ("train", stopped, "--dataset", short_recording, "--set", "train.seed=5")
    line = "holds an unfinished training with train.seed = 0, not 5: finish it with its own settings, or start over"
    assert line in refused(*other)
    assert cli(*other, "--restart").code == 130
    assert [options["resume"] for options in called] == [True, True, False]


@pytest.mark.slow  # with the real fit
def test_a_training_that_diverges_is_one_line(refused, tmp_path, short_recording):
    words = ("--dataset", short_recording, *SMALL, "--set", "train.learning_rate=1e12")
    line = refused("train", tmp_path / "model", *words)
    assert line.startswith("error: joint fit: the loss is not finite after ")
