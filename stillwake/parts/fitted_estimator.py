"""The fit of a bundle's sensor estimator to a data set, with a display of the progress."""

from collections.abc import Sequence
from pathlib import Path
from typing import Final

from contract.release.bundle import MadeEstimator
from contract.release.checks import sha256
from stillwake.console.progress import Report
from stillwake.console.terminal import console

_THREADS: Final = 1
"""Number of torch's threads. More threads would make the fit slower, and would round its sums differently."""


def fitted_estimator(dataset: Path, sensors: Sequence[str], window: int, report: Report) -> MadeEstimator:
    """Fit a sensor estimator for a controller with these sensors and this window to a data set."""
    from contract.recording.dataset import read
    from export.release.estimator import lowered_estimator
    from train.sensor_estimator import fit_estimator

    recording = read(dataset)
    network = fit_estimator(
        recording,
        sensors,
        window,
        threads=_THREADS,
        progress=lambda done, total: report("sensor estimator", done, total, unit="batches"),
    )
    provenance = {"dataset_sha256": sha256(dataset.read_bytes()), "torch_threads": _THREADS}
    made = lowered_estimator(network, recording, sensors, provenance)
    explained = ", ".join(f"{name} {value:.3f}" for name, value in made.provenance["r2"].items())
    console.print(f"R2 of each sensor from the others, on {' and '.join(made.provenance['judged_on'])}: {explained}")
    return made
