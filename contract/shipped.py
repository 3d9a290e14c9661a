"""The paths of the shipped files: the release bundle, and the data for simulation and training.

The bundle is part of the package. The data are a separate distribution, `stillwake-data`, which a vehicle does not
install. A checkout has the data in `data/`, even if the distribution is not installed.
"""

from importlib.util import find_spec
from pathlib import Path
from typing import Final

from contract.errors import StillwakeError

PACKAGE: Final = "stillwake_data"


_SPEC: Final = find_spec(PACKAGE)
_DATA: Final = (
    Path(_SPEC.origin).parent if _SPEC and _SPEC.origin else Path(__file__).resolve().parents[1] / "data" / PACKAGE
)
BUNDLE: Final = Path(__file__).resolve().parent / "release" / "shipped"
"""Path of the shipped release."""
RECORDING: Final = _DATA / "recording.h5"
"""Data set from which the shipped bundle was trained. `recording` checks that the file exists."""
MODEL: Final = _DATA / "model"
"""Model folder from which the shipped bundle was exported. `model` checks that the folder exists."""


def developed() -> Path:
    """Return the path of the developed wake, with which episodes begin; raises as `recording` does."""
    return _present(_DATA / "developed.npz", "the developed flow that runs begin with")


def recording() -> Path:
    """Return the path of the recording; raises StillwakeError if the data are not installed."""
    return _present(RECORDING, "the shipped recording")


def model() -> Path:
    """Return the path of the model folder; raises StillwakeError if the data are not installed."""
    _present(MODEL / "model.json", "the shipped model")
    return MODEL


def _present(path: Path, what: str) -> Path:
    if not path.is_file():
        raise StillwakeError(f"{what} is not installed: pip install ./data in a checkout of stillwake")
    return path
