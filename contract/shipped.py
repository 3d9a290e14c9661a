"""Where the shipped files lie: the release bundle, and the data that the laboratory starts from.

The bundle comes with the package. The data are a distribution of their own, `stillwake-data`, which a vehicle leaves
out; a checkout has them in `data/`, whether or not they are installed.
"""

from importlib.util import find_spec
from pathlib import Path
from typing import Final

from contract.errors import StillwakeError

PACKAGE: Final = "stillwake_data"


def _folder() -> Path:
    spec = find_spec(PACKAGE)
    if spec is not None and spec.origin is not None:
        return Path(spec.origin).parent
    return Path(__file__).resolve().parents[1] / "data" / PACKAGE


_DATA: Final = _folder()

BUNDLE: Final = Path(__file__).resolve().parent / "release" / "shipped"
"""The shipped release."""
DEVELOPED: Final = _DATA / "developed.npz"
"""A flow state with shedding established and no action: where episodes begin. `developed` reports a missing one."""
RECORDING: Final = _DATA / "recording.h5"
"""The data set that the shipped bundle was trained on. `recording` reports a missing one."""
MODEL: Final = _DATA / "model"
"""The model folder that the shipped bundle was exported from. `model` reports a missing one."""


def developed() -> Path:
    """The developed flow; raises StillwakeError where the data are not installed."""
    return _present(DEVELOPED, "the developed flow that runs begin from")


def recording() -> Path:
    """The recording; raises StillwakeError where the data are not installed."""
    return _present(RECORDING, "the shipped recording")


def model() -> Path:
    """The model folder; raises StillwakeError where the data are not installed."""
    _present(MODEL / "model.json", "the shipped model")
    return MODEL


def _present(path: Path, what: str) -> Path:
    if not path.is_file():
        raise StillwakeError(f"{what} is not installed: pip install ./data in a checkout of stillwake")
    return path
