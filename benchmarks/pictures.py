"""Draw every picture in `docs/pictures` that `results/*.json` alone decides: a part of `make tables`.

The pictures of the model's study need its networks as well, and are drawn by `python -m benchmarks model`.
"""

from typing import Final

from benchmarks.common.commands import ROOT
from benchmarks.controller import truncation_figure
from benchmarks.wake import grid_figure
from contract.atomic import replacing

PICTURES: Final = ROOT / "docs" / "pictures"


def main() -> None:
    """Draw the pictures anew."""
    drawn = {
        "cp_along_body": grid_figure.draw(ROOT / "results"),
        "truncation": truncation_figure.draw(ROOT / "results"),
    }
    for name, figure in drawn.items():
        with replacing(PICTURES / f"{name}.png") as temporary:
            figure.savefig(temporary, format="png")
