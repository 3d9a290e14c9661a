"""Every default says where it comes from, and what is said to be the paper's stands there."""

from pathlib import Path

from contract.config.listing import Setting, sections
from contract.config.tree import Config

DOCS = Path(__file__).resolve().parents[3] / "docs"

# Read off the manuscript, in the order of the text: what each place gives. Equations are counted through.
PAPER: dict[str, set[object]] = {
    "section 2.1": {7.647, 0.118, 500, 0.2, 0.075, 40, 10, 0.05, 0.25, 0.005, 0.45, 0.1, 0.4},
    "section 2.2.1": {32, 8},
    "section 2.2.4": {0.25, 0.02, 5, 512, 0.001, 300, 32, 8},
    "table 1": {64, 8, 256, 128, 2, 0.25},
    "equation 5": set(),  # the loss and its terms
    "section 2.3.1": {"shap", 100, 500, 10},
    "section 2.3.2": set(),  # distillation of the encoder, and of it alone
    "section 2.4": {25},
    "section 2.4.1": {1.051, 0.1, 0.01, 8.0},
    "equation 13": set(),  # mean and fluctuation of drag
    "equation 14": set(),  # lift: its mean magnitude
    "equation 15": set(),  # control: smoothness
    "section 2.4.2": {5, 0.001},
    "section 3.2": {4},
    "appendix A": {0.01, 0.8},
    "appendix B": {0},  # delays of 0 to 12 steps; noise on the sensors
}


def listed() -> list[Setting]:
    return [one for section in sections(Config()) for one in section.settings]


def test_every_default_has_a_source_that_gives_it():
    for one in listed():
        assert one.source is not None, one.name
        assert one.source.place if one.source.kind in ("paper", "standard") else one.source.note, one.name
    # What is the paper's stands at that place.
    for one in listed():
        if one.source.kind == "paper":
            assert one.source.place in PAPER, one.name
            # A note says how the default follows from what is not written there.
            assert one.source.note or one.paper in PAPER[one.source.place], one.name
    for page in {one.source.page for one in listed()} - {""}:
        assert (DOCS / page.partition("#")[0]).is_file(), page
