"""Where the files that come with the package lie."""

from importlib.resources import files
from pathlib import Path
from typing import Final

RECORDING: Final = Path(str(files("wake").joinpath("data/recording.h5")))
BUNDLE: Final = Path(str(files("firmware_sim").joinpath("data/bundle")))
