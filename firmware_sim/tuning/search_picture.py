"""A search as one picture: the scores in the order of the trials, and which setting matters."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Final

from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from optuna.trial import FrozenTrial, TrialState

from contract.atomic import replacing
from firmware_sim.tuning.score import TROUBLE

BLUE: Final = "#0072B2"
ORANGE: Final = "#E69F00"


def write_figure(path: Path, trials: Sequence[FrozenTrial], importances: Mapping[str, float]) -> None:
    """Write the picture as PNG.

    Args:
        trials: finished ones in order; the first is of the present settings.
        importances: share of each setting, most important first; may be empty.

    Raises:
        StillwakeError: it cannot be written.
    """
    figure = Figure(figsize=(10.0, 3.6), dpi=110, layout="constrained")
    FigureCanvasAgg(figure)
    left, right = figure.subplots(1, 2, width_ratios=(3, 2))
    sound = [
        (k, t.value) for k, t in enumerate(trials) if t.state == TrialState.COMPLETE and (t.value or 0.0) > TROUBLE
    ]
    given_up = [
        (k, list(t.intermediate_values.values())[-1])
        for k, t in enumerate(trials)
        if t.state == TrialState.PRUNED and t.intermediate_values
    ]
    values = [value for _, value in sound if value is not None]
    if given_up:
        left.plot(*zip(*given_up, strict=True), "x", color="0.6", label="given up")
    left.plot([k for k, _ in sound], values, "o", color=BLUE, markersize=4, label="all runs made")
    best = [max(values[: k + 1]) for k in range(len(values))]
    left.step([k for k, _ in sound], best, where="post", color=ORANGE, label="best so far")
    if values:
        left.axhline(values[0], color="0.3", linewidth=0.8, linestyle=":", label="present settings")
        # Hopeless trials lie far below; the scale is of those that count.
        left.set_ylim(bottom=min(values[0], max(values)) - 15.0)
    left.set_xlabel("trial")
    left.set_ylabel("score / points of drag reduction")
    left.legend(frameon=False, fontsize=8, loc="lower right")
    names = [name.rpartition(".")[2] for name in importances][::-1]
    right.barh(names, list(importances.values())[::-1], color=BLUE)
    right.set_xlabel("share in the variance of the score")
    if not importances:
        right.text(0.5, 0.5, "too few trials", ha="center", va="center", transform=right.transAxes, color="0.4")
        right.set_yticks([])
    with replacing(path) as temporary:
        figure.savefig(temporary, format="png")
