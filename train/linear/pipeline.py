"""From a recording to a stored linear model: identify, judge on what was held out, design, write."""

import hashlib
import platform
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from importlib.metadata import version
from pathlib import Path
from typing import Any, Final

import numpy as np

from contract.config.tree import Config
from contract.errors import ConfigError
from contract.model import linear_model_folder
from contract.model.linear_model_folder import LinearDescription
from contract.recording import dataset
from contract.recording.episode import Episode
from contract.recording.findings import agreeing
from contract.release.manifest import Scaling
from contract.sensor_layout import SensorLayout
from train.linear.differences import PROBE, SENSORS, Series, check_pairs, chosen_episodes, series_of
from train.linear.identification import HORIZONS, fit, growing_modes, refuse_spurious, roll_out_r2
from train.linear.lqr import design
from train.samples.scaling import fit_scaling

PHASES: Final = ("read", "judge", "identify", "design", "write")
"""Phases of an identification, in order."""


@dataclass(frozen=True, kw_only=True)
class Identification:
    """What the model is fitted to, and how.

    Attributes:
        episodes: patterns of names, as in a shell.
        leave_out: control steps at the beginning of each episode that are not used: its transient.
        window: L, control steps of memory.
        ridge: of the regression, for regressors with a mean square of one.
        held_out: the last part of each episode, on which a model fitted to the rest is judged.
        fastest: e-foldings in t_c by which a mode of the model may grow. The wake's own instability has about 0.1.
        sensors: pairs of mirror images.

    Raises ConfigError for a number outside its range.
    """

    episodes: tuple[str, ...] = ("controlled*",)
    leave_out: int = 500
    window: int = 64
    ridge: float = 1e-3
    held_out: float = 0.25
    fastest: float = 1.0
    sensors: tuple[str, ...] = SENSORS

    def __post_init__(self) -> None:
        _require(self.window >= 2, "window", self.window, "at least 2")
        _require(self.leave_out >= 0, "leave_out", self.leave_out, "not negative")
        _require(0.0 < self.ridge < np.inf, "ridge", self.ridge, "positive and finite")
        _require(0.0 < self.held_out < 1.0, "held_out", self.held_out, "between 0 and 1")
        _require(self.fastest > 0.0, "fastest", self.fastest, "positive")


@dataclass(frozen=True, kw_only=True)
class Design:
    """Weights of the regulator.

    Attributes:
        action: R, on the square of the action in U_inf W.
        differences: on the square of each difference, in Cp.
        lift: on the square of Cl.
        probe: on the square of the transverse velocity behind the body, in U_inf; needs that series if it is not 0.

    Raises ConfigError for a number outside its range.
    """

    action: float = 100.0
    differences: float = 10.0
    lift: float = 1.0
    probe: float = 1.0

    def __post_init__(self) -> None:
        _require(0.0 < self.action < np.inf, "action weight", self.action, "positive and finite")
        for name in ("differences", "lift", "probe"):
            value = getattr(self, name)
            _require(0.0 <= value < np.inf, f"{name} weight", value, "finite and not negative")


@dataclass(frozen=True, kw_only=True)
class Identified:
    """What was found.

    Attributes:
        steps: control steps that were fitted to.
        rows: what is predicted: the differences by their sensors, "Cl", and the probe where it has a weight.
        r2: of the model that did not see the held-out part, by steps ahead, a value a row.
        growing: growth in e-foldings a t_c and frequency in 1/t_c of each mode that grows, fastest first.
        open_loop, closed_loop: spectral radii, per control step.
        gain_sum: sum of the gain's magnitudes, in U_inf W per Cp or, for past actions, per U_inf W.
    """

    episodes: tuple[str, ...]
    steps: int
    rows: tuple[str, ...]
    r2: Mapping[str, tuple[float, ...]]
    growing: tuple[tuple[float, float], ...]
    open_loop: float
    closed_loop: float
    gain_sum: float
    versions: Mapping[str, str]

    def as_metrics(self) -> dict[str, Any]:
        """As a model folder keeps it."""
        tree = asdict(self)
        del tree["versions"]
        return tree


def identify_all(
    recording: Path,
    output: Path,
    config: Config,
    how: Identification,
    weights: Design,
    *,
    phase: Callable[[str], None] = lambda name: None,
) -> Identified:
    """Identify, design, and write the model folder, replacing a linear model that is there.

    Args:
        config: settings; control period and limit of the jets are taken from the recording where it knows them, and
            the window from `how`.
        phase: called with each of `PHASES` when it begins.

    Raises:
        DatasetError: the recording is not sound, or has no such episodes or sensors.
        IdentificationError: no model can be identified, or it has modes that grow too fast.
        DesignError: there is no stabilising regulator.
        StillwakeError: the place cannot be written, or holds something else.
    """
    linear_model_folder.check_free(output)
    phase("read")
    recorded = dataset.read(recording)
    settings = _settings(agreeing(recorded, config), how)
    check_pairs(recorded.layout, how.sensors)
    episodes = chosen_episodes(recorded.episodes, how.episodes)
    responses = ("Cl", PROBE) if weights.probe else ("Cl",)
    series = [series_of(item, recorded.layout, how.sensors, responses, how.leave_out) for item in episodes]
    names = _row_names(how.sensors, responses)

    phase("judge")
    r2 = _judged(series, how)
    phase("identify")
    model = fit(series, how.window, how.ridge)
    modes = growing_modes(model, settings.flow.control_period)
    refuse_spurious(modes, how.fastest)
    phase("design")
    by_row = {"Cl": weights.lift, PROBE: weights.probe}
    pairs = len(how.sensors) // 2
    regulator = design(model, [weights.differences] * pairs + [by_row[name] for name in responses], weights.action)
    done = Identified(
        episodes=tuple(item.name for item in episodes),
        steps=sum(len(item) - how.window for item in series if len(item) > how.window),
        rows=names,
        r2={str(ahead): tuple(float(value) for value in row) for ahead, row in zip(HORIZONS, r2, strict=True)},
        growing=tuple((mode.growth, mode.frequency) for mode in modes),
        open_loop=regulator.open_loop,
        closed_loop=regulator.closed_loop,
        gain_sum=float(np.abs(regulator.gain).sum()),
        versions={"python": platform.python_version(), **{name: version(name) for name in _PACKAGES}},
    )
    phase("write")
    columns = recorded.layout.indices(how.sensors)
    description = LinearDescription(
        config=settings,
        sensors=how.sensors,
        positions=tuple((float(x), float(y)) for x, y in recorded.layout.positions[columns]),
        scaling=_scaling(episodes, recorded.layout, how),
        identification=asdict(how),
        design=asdict(weights),
        metrics=done.as_metrics(),
        dataset_sha256=hashlib.sha256(recording.read_bytes()).hexdigest(),
        versions=done.versions,
    )
    linear_model_folder.write(output, description, model.coefficients[: pairs + 1], regulator.gain)
    return done


_PACKAGES: Final = ("stillwake", "numpy", "scipy")


def _settings(config: Config, how: Identification) -> Config:
    return replace(config, model=replace(config.model, window=how.window))


def _judged(series: Sequence[Series], how: Identification) -> np.typing.NDArray[np.float64]:
    """R2 on the last part of every episode, of a model fitted to the first parts."""
    ends = [round(len(item) * (1.0 - how.held_out)) for item in series]
    seen = [item.part(0, end) for item, end in zip(series, ends, strict=True)]
    unseen = [item.part(end, len(item)) for item, end in zip(series, ends, strict=True)]
    return roll_out_r2(fit(seen, how.window, how.ridge), unseen)


def _scaling(episodes: Sequence[Episode], layout: SensorLayout, how: Identification) -> Scaling:
    used = [
        replace(item, series={name: values[how.leave_out :] for name, values in item.series.items()})
        for item in episodes
    ]
    return fit_scaling(used, layout).of_sensors(layout.indices(how.sensors))


def _row_names(sensors: Sequence[str], responses: Sequence[str]) -> tuple[str, ...]:
    pairs = zip(sensors[::2], sensors[1::2], strict=True)
    return (*(f"{first} - {second}" for first, second in pairs), *responses)


def _require(holds: bool, name: str, value: float, rule: str) -> None:
    if not holds:
        raise ConfigError(f"{name} = {value:g}: must be {rule}")
