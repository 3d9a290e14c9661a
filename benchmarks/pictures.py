"""Draw every picture in `docs/pictures` that depends only on `results/*.json`; `make tables` does this too."""

from benchmarks.common.command_line import ROOT
from benchmarks.common.markdown import read
from benchmarks.common.pictures import draw
from benchmarks.release import release_drawings


def main() -> None:
    """Draw the pictures."""
    for name, drawn in (("release_figures", release_drawings.drawn), ("weights", release_drawings.weights)):
        source = ROOT / "results" / f"{name}.json"
        draw(drawn(read(source)["figures"]), source)
