"""The common parts of commands that train or fit: check of the output, display of progress, a line on how to continue
after a stop, and the fit of a bundle's sensor estimator."""

from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path

from contract.atomic import check_writable
from contract.model.model_folder import check_free
from contract.release.bundle import MadeEstimator
from contract.release.checks import sha256
from stillwake.console.outputs import check_output, claim
from stillwake.console.progress import Report
from stillwake.console.terminal import console
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


def fitted_estimator(dataset: Path, sensors: Sequence[str], window: int, report: Report) -> MadeEstimator:
    """Fit a sensor estimator for a controller with these sensors and this window to a data set."""
    from contract.recording.dataset import read
    from export.release.estimator import lowered_estimator
    from train.sensor_estimator import fit_estimator

    recording, threads = read(dataset), 1  # more threads are slower, and round sums differently
    show = partial(report, "sensor estimator", unit="batches")
    network = fit_estimator(recording, sensors, window, threads=threads, progress=show)
    provenance = {"dataset_sha256": sha256(dataset.read_bytes()), "torch_threads": threads}
    made = lowered_estimator(network, recording, sensors, provenance)
    explained = ", ".join(f"{name} {value:.3f}" for name, value in made.provenance["r2"].items())
    console.print(f"R2 of each sensor from the others, on {' and '.join(made.provenance['judged_on'])}: {explained}")
    return made
