"""Where the files that come with the package lie."""

from importlib.resources import files
from pathlib import Path
from typing import Final

BUNDLE: Final = Path(str(files("firmware_sim").joinpath("data/bundle")))
