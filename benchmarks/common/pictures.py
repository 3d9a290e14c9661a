"""The documents' pictures: their folder, the function that writes them, and the text that states a picture's results
file."""

import hashlib
import json
from collections.abc import Mapping
from pathlib import Path
from typing import Final

from matplotlib.figure import Figure

from benchmarks.common.command_line import ROOT
from contract.atomic import replacing

PICTURES: Final = ROOT / "docs" / "pictures"
SOURCE: Final = "Source"
"""Name of the text field in a PNG that identifies the results file from which the picture was drawn."""
STAMP: Final = "made"
"""Name of the entry in a results file that states the release and the C sources of the figures. A test uses this entry
to find outdated files."""


def draw(figures: Mapping[str, Figure], source: Path, folder: Path = PICTURES) -> None:
    """Write figures that were drawn from one results file; `figures` maps file names to figures."""
    for name, figure in figures.items():
        with replacing(folder / f"{name}.png") as temporary:
            figure.savefig(temporary, format="png", metadata={SOURCE: source_text(source)})


def source_text(source: Path) -> str:
    """Return the text that identifies a picture's results file: its path in the project and its SHA-256. The hash
    leaves out the stamp, because `benchmarks.full` adds the stamp after all pictures and tables were made."""
    place = source.relative_to(ROOT).as_posix() if source.is_relative_to(ROOT) else source.name
    content = json.loads(source.read_text(encoding="utf-8"))
    content["facts"].pop(STAMP, None)
    written = json.dumps(content, indent=2) + "\n"
    return f"{place} {hashlib.sha256(written.encode()).hexdigest()}"
