"""Draw every picture in `docs/pictures` that `results/*.json` alone decides: a part of `make tables`."""

from benchmarks.common.commands import ROOT
from benchmarks.common.markdown import read
from benchmarks.common.pictures import draw
from benchmarks.release import release_drawings


def main() -> None:
    """Draw the pictures again."""
    release = ROOT / "results" / "release_figures.json"
    draw(release_drawings.drawn(read(release)["figures"]), release)
