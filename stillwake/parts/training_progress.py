"""What trainings share: where they write, what they show meanwhile, how to go on when they are stopped."""

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path

from contract.atomic import check_writable
from contract.model.model_folder import check_free
from stillwake.console.claims import claim
from stillwake.console.outputs import check_output
from stillwake.console.progress import Report
from stillwake.console.stopping import go_on_with
from train.fitting import unfinished
from train.fitting.progress import Phase, Stopwatch


class TrainingProgress:
    """A `train.fitting.progress.Progress` that reports each phase. `watch` is what every phase took."""

    def __init__(self, report: Report) -> None:
        self.watch = Stopwatch()
        self._report = report

    def __call__(self, phase: Phase, step: int, total: int, terms: Mapping[str, float]) -> None:
        """Show how far the phase is."""
        self.watch(phase, step, total, terms)
        self._report(phase.label, step, total, "  ".join(f"{name} {value:.4f}" for name, value in terms.items()))


def check_model_output(output: Path, *, overwrite: bool) -> Path:
    """Claim the place of a model and of its checkpoints, which is returned. Raises StillwakeError if something is there
    that is not to be replaced, or nothing can be written."""
    claim(output, folder=True)
    check_free(output)
    check_output(output, overwrite=overwrite, folder=True, occupant="there is a model already")
    checkpoints = unfinished.folder_of(output)
    check_writable(checkpoints, folder=True)
    return checkpoints


@contextmanager
def continued(checkpoints: Path) -> Iterator[None]:
    """When the training is stopped, report how to go on."""
    try:
        yield
    except KeyboardInterrupt:
        reached = unfinished.reached(checkpoints)
        place = f"from {reached}" if reached else "from the beginning: there is no checkpoint yet"
        with go_on_with(f"the same command goes on {place}"):
            raise
