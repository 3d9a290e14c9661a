"""The check of a data set for properties that would make training or export fail."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from shlex import quote
from typing import Any, Final, Literal

import numpy as np

from contract.arrays import Array
from contract.config.tree import Config
from contract.errors import DatasetError
from contract.recording import needs
from contract.recording.dataset import Dataset, Episode
from contract.recording.episode import facts_in
from contract.recording.needs import Need
from contract.recording.plausible import dominant_frequency, implausible, longest_run, share_near

STEP_TOLERANCE: Final = 0.05
"""Largest deviation of a time step from the control period, as a share of the period. A clock error of a twentieth of a
period distorts the recorded ramp of the jets less than the finite resolution of the release's four pressures does."""
CLOCK_TOLERANCE: Final = 1e-3
"""Largest deviation of the mean time step, as a share of the period: over 25 steps, a fortieth of a step."""
LIMIT_TOLERANCE: Final = 1e-6
"""Largest excess of an action over the limit that rounding in a text file can cause, as a share of the limit."""
QUIET: Final = 0.05
"""Share of the action limit below which an action counts as zero or weak."""
_SPAN: Final = (0.05, 50.0)
"""Smallest and largest plausible extent of the sensors' positions, in W. Most extents in mm are outside this range."""
_USED: Final = 0.25
"""Smallest plausible ratio of the largest training action to the limit. With a wrong unit, the ratio is far smaller."""
_FREQUENCY: Final = (0.02, 2.0)
"""Plausible frequencies of the peak of Cl's spectrum, in U_inf / W. With times in s, the peak is mostly outside."""
_NARROW: Final = 0.1
"""Relative width of a frequency band that counts as one frequency."""
_POOR: Final = 0.9
"""The forcing counts as a single frequency if a narrow band has more than this share of the actions' power. A sine has
the share 1, even with an envelope. The paper's training waveform has 0.24, and the paper's chirp has 0.42."""
_SKEWED: Final = 0.5
"""Largest difference between the means of two mirrored sensors, in standard deviations of their pressures. The
difference is 0.1 in the whole shipped recording, and 0.25 in one of its episodes."""
_SAME: Final = 1e-6
"""Largest relative difference at which a fact about the plant and the setting of the same name count as equal."""


@dataclass(frozen=True, kw_only=True)
class Finding:
    """A line about a data set, with place and remedy. `stops` is the work that it prevents, or None for a warning."""

    stops: Literal["training", "export"] | None
    text: str


def findings(dataset: Dataset, config: Config, *, choosing: bool = True) -> tuple[Finding, ...]:
    """List all findings under the given settings; findings that prevent training come first. `choosing` states whether
    training chooses the sensors according to `config.train`; it is False if the caller names the sensors."""
    stopping = [
        *_unfit(dataset, config),
        *(text for episode in dataset.episodes for text in _of_episode(episode, dataset, config)),
    ]
    later = [*_constants(dataset, config), *(_selection(dataset, config) if choosing else ())]
    found = [
        *(Finding(stops="training", text=text) for text in stopping),
        *_too_short(dataset, config),
        *(Finding(stops="training", text=text) for text in later),
        *(Finding(stops=None, text=text) for text in _hints(dataset, config)),
    ]
    order = ("training", "export", None)
    return tuple(sorted(found, key=lambda item: order.index(item.stops)))


def _of_role(dataset: Dataset, role: str) -> list[Episode]:
    return [item for item in dataset.episodes if item.role == role]


def agreeing(dataset: Dataset, config: Config) -> Config:
    """Return a copy of the settings in which the known facts about the data set's plant replace values of `flow`."""
    known: dict[str, Any] = dict(dataset.plant.known)
    return replace(config, flow=replace(config.flow, **known))


def refuse_unfit(found: Sequence[Finding], name: str) -> None:
    """Raise DatasetError if a finding prevents training; the message has the first such finding."""
    stopping = [item.text for item in found if item.stops == "training"]
    if stopping:
        command = f"`stillwake dataset inspect {quote(name)}`"
        others = f" (and {len(stopping) - 1} more: see {command} with the same settings)"
        raise DatasetError(f"{name}: {stopping[0]}{others if len(stopping) > 1 else ''}")


def trainable(dataset: Dataset, config: Config) -> tuple[Episode, ...]:
    """Return the training episodes that are long enough for training."""
    steps = needs.fitting_need(config).steps
    return tuple(item for item in _of_role(dataset, "train") if len(item) >= steps)


def left_out(dataset: Dataset, config: Config) -> tuple[str, ...]:
    """Return a line for every training episode that is too short."""
    need = needs.fitting_need(config)
    return tuple(
        f"episode {item.name} has {len(item)} steps, too short for training: {_needed(need)}; it is left out"
        for item in _of_role(dataset, "train")
        if len(item) < need.steps
    )


def _unfit(dataset: Dataset, config: Config) -> Iterator[str]:
    for name, value in dataset.plant.known.items():
        setting = getattr(config.flow, name)
        if abs(value - setting) > _SAME * abs(value):
            yield (
                f"{name.replace('_', ' ')} is {value:g} in the data set, flow.{name} = {setting:g} in the settings: "
                f"use --set flow.{name}={value!r}, or --set SETTINGS.toml, the output of `stillwake dataset "
                f"inspect FILE --settings`"
            )
    for role, use in (("train", "to fit the model to"), ("test", "to judge the model on")):
        if not _of_role(dataset, role):
            remedy = f"import an episode with {role}=FILE; a long file can be cut in two"
            yield f"dataset has no episode with role {role!r}, {use}: {remedy}"


def _of_episode(episode: Episode, dataset: Dataset, config: Config) -> Iterator[str]:
    plant, name = dataset.plant, episode.name
    for fact, here in facts_in(episode.provenance).known.items():
        there = getattr(plant, fact)
        if there is not None and abs(here - there) > _SAME * abs(there):
            yield f"episode {name}: its provenance has flow.{fact} = {here:g}, the data set has {there:g}"
    period = plant.control_period or config.flow.control_period
    problem = clock_problem(episode.series["t"], period)
    if problem is not None:
        yield f"episode {name}: {problem}"
    limit = plant.action_limit or config.flow.action_limit
    actions = np.append(episode.initial_action, episode.series["action"])
    beyond = np.abs(actions) > limit * (1.0 + LIMIT_TOLERANCE)
    if beyond.any():
        largest = int(np.abs(actions).argmax())
        where = "before the first sample" if largest == 0 else f"at step {largest - 1}"
        many = f"({int(beyond.sum())} of {len(actions)} actions are)"
        yield f"episode {name}: action is {actions[largest]:g} {where}, beyond the limit of {limit:g} {many}"


def clock_problem(t: Array, period: float) -> str | None:
    """Describe the first error in times that should increase in steps of `period`; None if there is no error."""
    if len(t) < 2:
        return None
    steps = np.diff(t)
    if (steps <= 0).any():
        k = int(np.flatnonzero(steps <= 0)[0])
        return f"t does not rise from step {k} to {k + 1}: {t[k]:.15g}, {t[k + 1]:.15g}"
    off = np.abs(steps / period - 1.0)
    mean = float((t[-1] - t[0]) / (len(t) - 1))
    if off.max() <= STEP_TOLERANCE and abs(mean / period - 1.0) <= CLOCK_TOLERANCE:
        return None
    if abs(mean / period - 1.0) > CLOCK_TOLERANCE and np.ptp(steps) <= STEP_TOLERANCE * mean:
        return f"t rises by {mean:.6g}, must rise by the control period of {period:g}"
    k = int(off.argmax())
    return f"t rises by {steps[k]:.6g} from step {k} to {k + 1}, must rise by the control period of {period:g}"


def _too_short(dataset: Dataset, config: Config) -> Iterator[Finding]:
    training, tests, kept = _of_role(dataset, "train"), _of_role(dataset, "test"), trainable(dataset, config)
    for line in left_out(dataset, config):
        yield Finding(stops=None if kept else "training", text=line if kept else line.removesuffix("; it is left out"))
    window, horizon = config.model.window, config.mpc.horizon
    gate, calibrated = needs.GATE_WINDOWS, needs.LEAST_CALIBRATION
    rolled = Need(steps=window + horizon, reason=f"a window of {window} and the horizon of {horizon} steps")
    replayed = Need(steps=window - 1 + gate, reason=f"{gate} windows of {window} to check the export")
    rounded = Need(steps=window - 1 + calibrated, reason=f"{calibrated} windows of {window} to calibrate int8")
    demands: list[tuple[Sequence[Episode], Need, Literal["training", "export"]]] = [
        (kept if config.model.is_slimmed else (), rolled, "training"),
        (tests, needs.judging_need(config), "training"),
        (tests, replayed, "export"),
        (training, rounded, "export"),
    ]
    for episodes, need, stops in demands:
        longest = max(episodes, key=len, default=None)
        if longest is not None and len(longest) < need.steps:
            role = "training" if longest.role == "train" else "test"
            text = f"{role} episodes are too short, the longest is {longest.name} with {len(longest)} steps"
            yield Finding(stops=stops, text=f"{text}: {_needed(need)}")
    compute_ms, period_ms = config.ecu.compute_time_ms, config.period_ns / 1e6
    if compute_ms > period_ms:
        text = f"must be within the control period, which is {period_ms:g} ms at this operating_point"
        yield Finding(stops="export", text=f"ecu.compute_time_ms = {compute_ms:g}: {text}")


def _needed(need: Need) -> str:
    return f"{need.reason} need {need.steps}"


def _constants(dataset: Dataset, config: Config) -> Iterator[str]:
    kept, tests = trainable(dataset, config), _of_role(dataset, "test")
    if kept:
        pressure = np.concatenate([item.series["Cp"] for item in kept])
        for name, values in zip(dataset.layout.names, pressure.T, strict=True):
            yield from _constant(f"sensor {name}", values, "training", "it has no information; leave it out")
    for episodes, names, role, why in (
        (kept, ("action", "Cd", "Cl"), "training", "nothing to learn from"),
        (tests, ("Cd", "Cl"), "test", "errors cannot be normalised"),
    ):
        for name in names if episodes else ():
            yield from _constant(name, np.concatenate([item.series[name] for item in episodes]), role, why)


def _constant(name: str, values: Array, role: str, why: str) -> Iterator[str]:
    if np.ptp(values) == 0.0:
        yield f"{name} is constant at {values[0]:g} in all {role} episodes: {why}"


def _selection(dataset: Dataset, config: Config) -> Iterator[str]:
    train, layout = config.train, dataset.layout
    if train.sensors > len(layout):
        yield f"train.sensors = {train.sensors}: must be from 1 to {len(layout)}, the number of sensors"
    if train.selection == "shap":
        images = 1 if layout.mirror is None else 2
        windows = images * sum(needs.windows_in(len(item), config.model.window) for item in trainable(dataset, config))
        wanted = max(train.shap_background, train.shap_explained)
        if windows < wanted:
            yield (
                f"training episodes hold {windows} windows, too few for {wanted} samples of the ranking: lower "
                f"train.shap_background and train.shap_explained, or use train.selection=greedy"
            )


def _hints(dataset: Dataset, config: Config) -> Iterator[str]:
    if dataset.layout.mirror is None:
        alone = dataset.layout.without_partner()
        why = f"{alone[0]} for example: no sensor is at (x, -y)" if alone else "because body or jets are not symmetric"
        yield f"the sensors have no mirror images, {why}; so training has no mirrored data, only the recording"
    yield from implausible(dataset)
    yield from asymmetry(dataset)
    yield from _units(dataset)
    yield from _forcing(dataset)
    training = _of_role(dataset, "train")
    limit = dataset.plant.action_limit or config.flow.action_limit
    window = config.model.window
    if window % needs.WINDOW_STEP:
        yield (
            f"model.window = {window}: with a sensor check, the ECU in C accepts multiples of {needs.WINDOW_STEP}; "
            f"the nearest is {needs.window_for_c(window)}"
        )
    if training and max(longest_run(np.abs(item.series["action"]) <= QUIET * limit)[1] for item in training) < window:
        yield (
            f"no training episode has {window} steps in a row with jets off or below {QUIET:.0%} of the limit: "
            f"the model does not see the uncontrolled wake"
        )


def asymmetry(dataset: Dataset) -> Iterator[str]:
    """Report mirrored sensors whose mean pressures differ. Such a recording has no valid mirror image."""
    mirror, training = dataset.layout.mirror, [item.series["Cp"] for item in _of_role(dataset, "train")]
    if mirror is None or not training:
        return
    pressure = np.concatenate(training)
    mean, deviation = pressure.mean(axis=0), pressure.std(axis=0)
    apart = np.abs(mean - mean[mirror]) - _SKEWED * np.maximum(deviation, deviation[mirror])
    worst = int(apart.argmax())
    if apart[worst] > 0.0:
        one, other = (dataset.layout.names[k] for k in (worst, mirror[worst]))
        yield (
            f"{one} and {other} are mirror images, but their mean Cp is {mean[worst]:.3g} and "
            f"{mean[mirror[worst]]:.3g}, with deviations of {deviation[worst]:.2g} and {deviation[mirror[worst]]:.2g}: "
            f"training also learns the mirrored flow; import with --asymmetric if body or jets are not symmetric"
        )


def _forcing(dataset: Dataset) -> Iterator[str]:
    period = dataset.plant.control_period
    if period is None:
        return
    peaks: list[float] = []
    for episode in _of_role(dataset, "train"):
        action = episode.series["action"]
        peak = dominant_frequency(action, period)
        if peak is None:
            continue
        if len(action) * period * peak < 2.0 / _NARROW:
            return  # the record is too short to separate frequencies that are so close
        if share_near(action, period, peak, _NARROW) < _POOR or (peaks and abs(peak / peaks[0] - 1.0) > _NARROW):
            return
        peaks.append(peak)
    if peaks:
        yield (
            f"the actions of all training episodes are of one frequency, {peaks[0]:.3g} U_inf / W: a model "
            f"cannot learn other responses; sweep the frequencies that a controller may use"
        )


def _units(dataset: Dataset) -> Iterator[str]:
    positions = dataset.layout.positions
    span = float(np.ptp(positions, axis=0).max())
    if len(positions) > 1 and not _SPAN[0] <= span <= _SPAN[1]:
        yield f"the sensors span {span:.3g} W: positions are in W, so divide lengths by the width of the body"
    training = _of_role(dataset, "train")
    limit, period = dataset.plant.action_limit, dataset.plant.control_period
    largest = max((float(np.abs(item.series["action"]).max()) for item in training), default=0.0)
    if limit is not None and 0.0 < largest < _USED * limit:
        yield (
            f"no action of the training episodes is above {largest:.3g}, but the limit is {limit:g}: the model does "
            f"not learn larger actions; flow.action_limit should be about the largest action that was recorded"
        )
    if not training or period is None:
        return
    longest = max(training, key=len)
    frequency = dominant_frequency(longest.series["Cl"], period)
    if frequency is not None and not _FREQUENCY[0] <= frequency <= _FREQUENCY[1]:
        yield (
            f"Cl of {longest.name} has its peak at {frequency:.3g} U_inf / W, but most wakes have it at 0.1 to 0.4: "
            f"t and flow.control_period are in W / U_inf, so divide seconds by W / U_inf (--reference t=NUMBER)"
        )
