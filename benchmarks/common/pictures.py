"""Where the documents' pictures lie, how they are written, and how a test sees that they are stale."""

import hashlib
import json
from collections.abc import Mapping
from pathlib import Path
from typing import Final

from matplotlib.figure import Figure

from benchmarks.common.commands import ROOT
from contract.atomic import replacing

PICTURES: Final = ROOT / "docs" / "pictures"
SOURCE: Final = "Source"
"""Name of the text in a PNG that names what it was drawn from."""
STAMP: Final = "made"
"""The fact that a file has by which it is known to be of the present release and sources."""


def draw(figures: Mapping[str, Figure], source: Path, folder: Path = PICTURES) -> None:
    """Write figures, by the names of their files, that were drawn from one file of results."""
    for name, figure in figures.items():
        with replacing(folder / f"{name}.png") as temporary:
            figure.savefig(temporary, format="png", metadata={SOURCE: source_text(source)})


def source_text(source: Path) -> str:
    """What a picture states of the file it was drawn from: its place in the project and its SHA-256.

    Without the stamp, which a file gets when all that is made of it is there (`benchmarks.full`).
    """
    place = source.relative_to(ROOT).as_posix() if source.is_relative_to(ROOT) else source.name
    content = json.loads(source.read_text(encoding="utf-8"))
    content["facts"].pop(STAMP, None)
    written = json.dumps(content, indent=2) + "\n"
    return f"{place} {hashlib.sha256(written.encode()).hexdigest()}"
