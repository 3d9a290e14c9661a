"""The settings that follow from a data set."""

from collections.abc import Iterator
from dataclasses import replace
from typing import Final

import numpy as np

from contract.recording.dataset import Dataset, Episode
from contract.recording.episode import FACTS
from contract.recording.findings import QUIET
from contract.recording.needs import WINDOW_STEP, window_for_c
from contract.recording.plausible import dominant_frequency, longest_run

WINDOW_CYCLES: Final = 1.28
"""Length of the encoder's window, in shedding cycles: the paper's 32 steps at 25 steps per cycle."""
_PRACTICAL: Final = (10, 60)
"""Smallest and largest number of control steps per cycle for which horizon and window are derived from the cycle. With
fewer steps the jets' ramp is coarse; with more steps a control step takes too long."""
LEAST_CALM: Final = 25
"""Smallest number of unforced steps whose mean drag represents the uncontrolled flow: one cycle of the truck's wake."""


def uncontrolled(dataset: Dataset) -> Episode | None:
    """Return the longest part of any episode in which all actions are zero or weak; None if there is no such part."""
    limit = dataset.plant.action_limit
    best: Episode | None = None
    for episode in dataset.episodes:
        action = np.abs(episode.series["action"])
        threshold = QUIET * (limit if limit is not None else float(action.max()))
        start, length = longest_run(action <= threshold)
        if length > (len(best) if best else 0):
            series = {name: values[start : start + length] for name, values in episode.series.items()}
            best = replace(episode, series=series, initial_action=0.0, provenance={})
    return best


def fitting_settings(dataset: Dataset) -> str:
    """Return the text of a TOML file for `--set`: the settings that follow from the data set, with reasons."""
    return "\n".join(_settings_lines(dataset)) + "\n"


def _settings_lines(dataset: Dataset) -> Iterator[str]:
    plant, period = dataset.plant, dataset.plant.control_period
    yield "# Settings that follow from the data set; all other settings have the release's values."
    yield "[flow]"
    for name in FACTS:
        yield f"{name} = {plant.known[name]!r}" if name in plant.known else f"# {name}: not known"
    calm = uncontrolled(dataset)
    calm = None if calm is None or len(calm) < LEAST_CALM else calm
    where = f"all episodes: none is uncontrolled for {LEAST_CALM} steps"
    where = f"uncontrolled, {len(calm)} steps of {calm.name}" if calm else where
    drag = np.concatenate([item.series["Cd"] for item in ([calm] if calm else dataset.episodes)])
    frequency = dominant_frequency(calm.series["Cl"], period) if calm and period else None
    cycle = round(1.0 / (frequency * period)) if frequency and period else None
    practical = cycle is not None and _PRACTICAL[0] <= cycle <= _PRACTICAL[1]
    yield ""
    if cycle is not None:
        yield f"# One cycle of the uncontrolled Cl, at {frequency:.3g} / t_c, takes {cycle} control steps."
        if not practical:
            yield f"# That is outside {_PRACTICAL[0]} to {_PRACTICAL[1]}: choose another control period, if you can."
    yield "[mpc]"
    yield f"drag_reference = {float(drag.mean()):.6g}  # mean Cd, {where}"
    if practical and cycle is not None:
        yield f"horizon = {cycle}  # one cycle"
        yield "\n[model]"
        whole = f"to a multiple of {WINDOW_STEP}, which the ECU in C accepts"
        yield f"window = {window_for_c(WINDOW_CYCLES * cycle)}  # {WINDOW_CYCLES} cycles, {whole}"
    if len(dataset.layout) < 4:
        yield "\n[train]"
        yield f"sensors = {len(dataset.layout)}  # all sensors"
