"""A sensor estimator for a bundle, fitted to a data set while people watch."""

from pathlib import Path
from typing import Final

from contract.release.bundle import MadeEstimator
from contract.release.checks import sha256
from contract.release.manifest import Manifest
from stillwake.console.progress import Report
from stillwake.console.terminal import console

_THREADS: Final = 1
"""Of torch: more are slower, and other sums."""


def fitted_estimator(dataset: Path, report: Report, manifest: Manifest) -> MadeEstimator:
    """A sensor estimator for a controller, fitted to a data set."""
    from contract.recording.dataset import read
    from export.int8.rounded_estimator import rounded_estimator
    from export.to_onnx.sensor_estimator import build_estimator
    from train.sensor_estimator import fit_estimator

    fitted = fit_estimator(
        read(dataset),
        manifest.sensors,
        manifest.window,
        rounded=lambda network: rounded_estimator(network).network,
        threads=_THREADS,
        progress=lambda done, total: report("sensor estimator", done, total, unit="batches"),
    )
    r2 = dict(zip(manifest.sensors, fitted.r2, strict=True))
    explained = ", ".join(f"{name} {value:.3f}" for name, value in r2.items())
    console.print(f"R2 of each sensor by the others, on {' and '.join(fitted.judged_on)}: {explained}")
    return MadeEstimator(
        graph=build_estimator(rounded_estimator(fitted.network)).SerializeToString(),
        figures=fitted.figures,
        provenance={
            "dataset_sha256": sha256(dataset.read_bytes()),
            "judged_on": fitted.judged_on,
            "r2": r2,
            "torch_threads": _THREADS,
        },
    )
