"""Draw every picture in `docs/pictures` that depends only on `results/*.json`; `make tables` does this too."""

from benchmarks.common.commands import ROOT
from benchmarks.common.markdown import read
from benchmarks.common.pictures import draw
from benchmarks.release import release_drawings, weights


def main() -> None:
    """Draw the pictures."""
    release = ROOT / "results" / "release_figures.json"
    draw(release_drawings.drawn(read(release)["figures"]), release)
    of_weights = ROOT / "results" / "weights.json"
    draw(weights.drawn(read(of_weights)["figures"]), of_weights)
