"""Where the room's shipped files lie."""

from importlib.resources import files
from pathlib import Path
from typing import Final

_DATA: Final = Path(str(files("wake").joinpath("data")))

DEVELOPED: Final = _DATA / "developed.npz"
"""A flow state with shedding established and no action: where episodes begin."""
RECORDING: Final = _DATA / "recording.h5"
"""The data set that the shipped bundle was trained on."""
