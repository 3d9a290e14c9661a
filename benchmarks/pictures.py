"""Draw every picture in `docs/pictures` that `results/*.json` alone decides: a part of `make tables`.

Two pictures of the model's study need its networks as well, and are drawn by `python -m benchmarks model`.
"""

from benchmarks.common.commands import ROOT
from benchmarks.common.markdown import read
from benchmarks.common.pictures import draw
from benchmarks.controller import truncation_figure
from benchmarks.model.study import figures
from benchmarks.release import release_drawings
from benchmarks.wake import grid_figure


def main() -> None:
    """Draw the pictures anew."""
    results = ROOT / "results"
    draw({"cp_along_body": grid_figure.draw(results)}, results / "wake.json")
    draw({"truncation": truncation_figure.draw(results)}, results / "truncation.json")
    release = results / "release_figures.json"
    draw(release_drawings.drawn(read(release)["figures"]), release)
    draw(figures.drawn(results / "model.json"), results / "model.json")
