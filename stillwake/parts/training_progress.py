"""The common parts of the training commands: check of the output, display of progress, and a line on how to continue
after a stop."""

from collections.abc import Mapping
from pathlib import Path

from contract.atomic import check_writable
from contract.model.model_folder import check_free
from stillwake.console.outputs import check_output, claim
from stillwake.console.progress import Report
from train.fitting import unfinished
from train.fitting.progress import Phase, Stopwatch


class TrainingProgress:
    """A `train.fitting.progress.Progress` that shows each phase's progress; `watch` measures the durations."""

    def __init__(self, report: Report) -> None:
        self.watch = Stopwatch()
        self._report = report

    def __call__(self, phase: Phase, step: int, total: int, terms: Mapping[str, float]) -> None:
        """Show the progress of a phase."""
        self.watch(phase, step, total, terms)
        self._report(phase.label, step, total, "  ".join(f"{name} {value:.4f}" for name, value in terms.items()))


def check_model_output(output: Path, *, overwrite: bool) -> Path:
    """Lock the path of a model, check that the model's checkpoints can be written, and return their folder. Raises
    StillwakeError if a model exists and must not be replaced, or if nothing can be written there."""
    claim(output, folder=True)
    check_free(output)
    check_output(output, overwrite=overwrite, folder=True, occupant="holds a model already")
    checkpoints = unfinished.folder_of(output)
    check_writable(checkpoints, folder=True)
    return checkpoints


def advice(checkpoints: Path) -> str:
    """Return a line on how to continue a training that was stopped."""
    reached = unfinished.reached(checkpoints)
    place = f"from {reached}" if reached else "from the beginning: there is no checkpoint yet"
    return f"the same command continues {place}"
