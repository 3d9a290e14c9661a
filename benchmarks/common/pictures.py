"""Where the documents' pictures lie, and how they are written."""

from collections.abc import Mapping
from typing import Final

from matplotlib.figure import Figure

from benchmarks.common.commands import ROOT
from contract.atomic import replacing

PICTURES: Final = ROOT / "docs" / "pictures"


def draw(figures: Mapping[str, Figure]) -> None:
    """Write figures by the names of their files."""
    for name, figure in figures.items():
        with replacing(PICTURES / f"{name}.png") as temporary:
            figure.savefig(temporary, format="png")
