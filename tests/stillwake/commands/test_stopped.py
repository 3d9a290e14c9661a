"""What `train` and `record` say when they are stopped, when they go on, and when there is nothing to do."""

import hashlib
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from contract.config.loading import load_config
from contract.shipped import RECORDING
from train.fitting import unfinished
from train.fitting.progress import Phase
from train.fitting.unfinished import Identity, Reached

SMALL = [
    word
    for setting in (
        *("model.lstm_width=4", "model.dynamics_width=4", "model.decoder_width=4", "model.window=8"),
        *("train.batch_size=16", "train.segment=1", "train.epochs=100"),
    )
    for word in ("--set", setting)
]


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
def stopped(tmp_path: Path) -> Path:
    """The output of a training with the default settings that was stopped after a checkpoint."""
    output = tmp_path / "model"
    identity = Identity.of(load_config(), hashlib.sha256(RECORDING.read_bytes()).hexdigest(), "cpu", None)
    folder = unfinished.folder_of(output)
    unfinished.note(folder, identity, Reached(phase=Phase.FIT, step=300, total=4000))
    (folder / "fit.pt").write_bytes(b"")
    return output


def flat(text: str) -> str:
    return " ".join(text.split())


def test_a_training_that_is_stopped_early_says_that_nothing_is_kept(
    cli: Callable[..., Any], called: list[dict[str, Any]], tmp_path: Path
) -> None:
    outcome = cli("train", tmp_path / "model")
    line = "stopped; the same command goes on from the beginning: there is no checkpoint yet\n"
    assert (outcome.code, outcome.err) == (130, line)
    assert list(tmp_path.iterdir()) == []


def test_the_same_command_goes_on_and_says_from_where(
    cli: Callable[..., Any], called: list[dict[str, Any]], stopped: Path
) -> None:
    outcome = cli("train", stopped)
    assert "model.checkpoints ends: joint fit, iteration 300 of 4000" in flat(outcome.out)
    assert outcome.err == "stopped; the same command goes on from joint fit, iteration 300 of 4000\n"
    assert [options["resume"] for options in called] == [True]


def test_the_old_option_is_still_taken(cli: Callable[..., Any], called: list[dict[str, Any]], stopped: Path) -> None:
    assert cli("train", stopped, "--resume").code == 130
    assert "--resume" not in cli("train", "--help").out


def test_another_training_is_refused_and_can_start_over(
    cli: Callable[..., Any], called: list[dict[str, Any]], stopped: Path
) -> None:
    other = ("train", stopped, "--set", "train.seed=5")
    outcome = cli(*other)
    assert outcome.code == 1
    assert "holds an unfinished training with train.seed = 0, not 5: finish it with those, or start over" in outcome.err
    assert called == []
    assert cli(*other, "--restart").code == 130
    assert [options["resume"] for options in called] == [False]


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
    outcome = cli("record", tmp_path / "a.h5", "--start", "s.npz", "--training", 20)
    assert (outcome.code, outcome.err) == (0, "")
    assert f"already whole, nothing to record: {tmp_path / 'a.h5'}: 2020 control steps" in flat(outcome.out)
    assert (seen["start"], seen["overwrite"]) == (Path("s.npz"), False)


def test_a_state_of_another_reynolds_number_names_a_command_that_makes_one(
    cli: Callable[..., Any], tmp_path: Path
) -> None:
    outcome = cli("record", tmp_path / "a.h5", "--set", "flow.reynolds=1000")
    assert outcome.code == 1
    assert (
        "`stillwake develop start_re1000.npz --set flow.reynolds=1000` makes a start for it, which --start"
        in outcome.err
    )
    # Nothing is shown before the error, and nothing is left.
    assert outcome.out.strip() == ""
    assert list(tmp_path.iterdir()) == []


@pytest.mark.processes
def test_sigterm_ends_a_training_as_ctrl_c_does_and_it_goes_on(tmp_path: Path) -> None:
    output = tmp_path / "model"
    command = [sys.executable, "-m", "stillwake", "train", str(output), *SMALL]
    for number, status in ((signal.SIGTERM, 143), (signal.SIGINT, 130)):
        before = unfinished.reached(unfinished.folder_of(output))
        with subprocess.Popen(
            command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, preexec_fn=_deaf_to_nothing
        ) as process:
            deadline = time.monotonic() + 240.0
            while unfinished.reached(unfinished.folder_of(output)) == before:
                if process.poll() is not None or time.monotonic() > deadline:
                    process.kill()
                    pytest.fail(f"no checkpoint was written: {process.communicate()}")
                time.sleep(0.05)
            process.send_signal(number)
            out, err = process.communicate(timeout=120.0)
        reached = unfinished.reached(unfinished.folder_of(output))
        assert (process.returncode, err) == (status, f"stopped; the same command goes on from {reached}\n")
        assert "wrote" not in out
        if before is not None:
            assert f"ends: {before}" in flat(out)
        # No half-written file.
        assert sorted(path.name for path in tmp_path.rglob("*")) == ["fit.pt", "model.checkpoints", "training.json"]


def _deaf_to_nothing() -> None:
    # Shells start background jobs deaf to Ctrl-C, and a test may run in one.
    signal.signal(signal.SIGINT, signal.default_int_handler)


@pytest.mark.slow
def test_a_training_that_diverges_is_one_line(cli: Callable[..., Any], tmp_path: Path) -> None:
    """From the shipped recording, with the real fit."""
    import torch

    torch.set_num_threads(1)
    outcome = cli("train", tmp_path / "model", *SMALL, "--set", "train.learning_rate=1e30")
    assert outcome.code == 1
    assert outcome.err.startswith("error: joint fit: the loss is not finite after ")
    assert outcome.err.count("\n") == 1
    assert list(tmp_path.iterdir()) == []
