"""What a training shows while it runs, and how to go on when it is stopped."""

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path

from rich.progress import Progress as Bar
from rich.progress import TaskID

from stillwake.console.stopping import go_on_with
from train.fitting import unfinished
from train.fitting.progress import Phase, Stopwatch


class PhaseBars:
    """A `train.fitting.progress.Progress` with a line for each phase. `watch` is what every phase took."""

    def __init__(self, bar: Bar) -> None:
        self.watch = Stopwatch()
        self._bar, self._tasks = bar, dict[Phase, TaskID]()

    def __call__(self, phase: Phase, step: int, total: int, terms: Mapping[str, float]) -> None:
        """Show how far the phase is."""
        if phase not in self._tasks:
            self._tasks[phase] = self._bar.add_task(phase.label, total=total, note="")
        self.watch(phase, step, total, terms)
        note = "  ".join(f"{name} {value:.4f}" for name, value in terms.items())
        self._bar.update(self._tasks[phase], completed=step, note=note)


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
