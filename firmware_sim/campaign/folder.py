"""The folder of a campaign. The initial states of its runs are the wake at several shedding phases, so that no result
depends on a single phase.

campaign.json           the label: settings, seed, spans and bundle; a call with another label needs --overwrite
starts/phase_0.npz      initial flow state of the runs; NAME.phase_0.npz if scenario NAME has its own plant
runs/NAME.phase0.json   the outcome of a finished run
table.csv, figures/, report.html
"""

import json
import shutil
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any, Final

import numpy as np

from contract.arrays import Array
from contract.atomic import check_writable, names_in, replacing
from contract.config.body import TRUCK_BODY
from contract.config.tree import Config
from contract.errors import ConfigError, OutputError, PlantError
from contract.typed import typed
from wake.truck.develop import develop
from wake.truck.state import State, check_origin, developed_state, load_state, save_state
from wake.truck.truck_wake import TruckWake

CAMPAIGN_SCHEMA: Final = "stillwake-campaign/1"
_RUN_SCHEMA: Final = "stillwake-campaign-run/1"
COURSE: Final = ("t", "Cd", "Cl", "action")
"""Names of the stored series, which have one value per control period."""
DECIMALS: Final = 6
"""Number of decimals of the stored series. At the default operating point, the bus resolves actions to 3.2e-6."""


@dataclass(frozen=True, kw_only=True)
class KeptCourse:
    """The stored series of a run, with the names in `COURSE`, and the time of the request for control."""

    t: list[float]
    Cd: list[float]
    Cl: list[float]
    action: list[float]
    enabled_t: float

    @classmethod
    def of(cls, series: Mapping[str, Array], enabled_t: float) -> "KeptCourse":
        kept = {name: [round(float(value), DECIMALS) for value in series[name]] for name in COURSE}
        return cls(**kept, enabled_t=round(enabled_t, DECIMALS))


@dataclass(frozen=True, kw_only=True)
class MeanFigures:
    """The means over the averaged periods; `Sample` defines the coefficients."""

    Cd: float
    abs_Cl: float
    mean_Cl: float
    rms_action: float

    @classmethod
    def over(cls, course: KeptCourse, from_t: float) -> "MeanFigures":
        """Average over the samples from `from_t` on, so runs with and without control cover the same instants."""
        kept = np.array(course.t) >= from_t - 1e-9  # allows for rounding in sums of spans
        cd, cl, action = (np.array(getattr(course, name))[kept] for name in ("Cd", "Cl", "action"))
        rms = float(np.sqrt((action**2).mean()))
        return cls(Cd=float(cd.mean()), abs_Cl=float(np.abs(cl).mean()), mean_Cl=float(cl.mean()), rms_action=rms)


@dataclass(frozen=True, kw_only=True)
class RunService:
    """The counts of the ECU and the bus in a run under control: periods with a request for control after the
    controller's window was filled, those of them in which the controller planned, latched faults, periods in which the
    controller did not plan by the name of the ECU's Reason, pressure frames and commands, violated invariants."""

    requested: int
    in_control: int
    latches: int
    reasons: dict[str, int] = field(default_factory=dict)
    frames_sent: int
    frames_lost: int
    frames_rejected: int
    violations: int = 0
    broken: list[str] = field(default_factory=list)


@dataclass(frozen=True, kw_only=True)
class RunOutcome:
    """The outcome of one run. `key` is the hash of everything that the run depends on. If the run did not finish,
    `failure` states why, and the fields with results are None. In a run without control, `service` is None."""

    key: str
    figures: MeanFigures | None = None
    course: KeptCourse | None = None
    service: RunService | None = None
    failure: str = ""


class CampaignFolder:
    def __init__(self, path: Path) -> None:
        self.path, self.figures = path, path / "figures"
        self.table, self.report = path / "table.csv", path / "report.html"
        self.label, self._runs = path / "campaign.json", path / "runs"

    def start(self, phase: int, scenario: str = "") -> Path:
        """Return the file with the flow state at a starting phase; without `scenario`, the file of the common plant."""
        return self.path / "starts" / f"{scenario and scenario + '.'}phase_{phase}.npz"

    def check(self, label: Mapping[str, Any], *, overwrite: bool) -> None:
        """Check the folder without changing it. Raises OutputError if it contains files that no campaign wrote or,
        without `overwrite`, a campaign with another label; StillwakeError if the folder cannot be written."""
        check_writable(self.path, folder=True)
        if not self.path.exists() or not names_in(self.path):
            return
        present = _read(self.label, CAMPAIGN_SCHEMA)
        if present is None:
            raise OutputError(f"{self.path}: holds files that no campaign wrote; give another folder")
        if present != _plain(label) and not overwrite:
            names = ", ".join(sorted(n for n in present.keys() | label.keys() if present.get(n) != label.get(n)))
            remedy = "give another folder, or --overwrite to replace it"
            raise OutputError(f"{self.path}: holds a campaign with other {names}; {remedy}")

    def has_starts_of(self, label: Mapping[str, Any]) -> bool:
        """Return whether the initial states in the folder have the program, phases and settings of this label."""
        present, wanted = _read(self.label, CAMPAIGN_SCHEMA) or {}, _plain(label)
        return all(present.get(name) == wanted.get(name) for name in ("version", "phases", "settings"))

    def claim(self, label: Mapping[str, Any]) -> None:
        """Write the label; first delete the files of a campaign with another label, which `check` has allowed."""
        if _read(self.label, CAMPAIGN_SCHEMA) != _plain(label):
            for folder in ("starts", "runs", "figures"):
                shutil.rmtree(self.path / folder, ignore_errors=True)
            for file in (self.table, self.report):
                file.unlink(missing_ok=True)
        with replacing(self.label) as temporary:
            temporary.write_text(json.dumps(label, indent=2, sort_keys=True) + "\n", encoding="utf-8")

    def outcome(self, name: str, key: str) -> RunOutcome | None:
        """Return the finished run of this name; None if its file is missing, damaged, or has another schema or key."""
        tree = _read(self._runs / f"{name}.json", _RUN_SCHEMA)
        if tree is None:
            return None
        del tree["schema"]
        try:
            kept = typed(tree, RunOutcome)
        except (ValueError, RecursionError, ConfigError):
            return None
        return kept if kept.key == key else None

    def keep(self, name: str, outcome: RunOutcome) -> None:
        """Write a run, completely or not at all. A failed run is not written: the next call computes it again."""
        if not outcome.failure:
            content = {"schema": _RUN_SCHEMA, **asdict(outcome)}
            with replacing(self._runs / f"{name}.json") as temporary:
                temporary.write_text(json.dumps(content, sort_keys=True) + "\n", encoding="utf-8")

    @property
    def finished(self) -> int:
        return sum(1 for _ in self._runs.glob("*.json"))


def _read(path: Path, schema: str) -> dict[str, Any] | None:
    """Return the content of a JSON file; None if the file is missing, damaged or of another schema."""
    try:
        tree: Any = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError, RecursionError):
        return None
    return tree if isinstance(tree, dict) and tree.get("schema") == schema else None


def _plain(label: Mapping[str, Any]) -> Any:
    """Return the label as it is after being written as JSON and read again."""
    return json.loads(json.dumps(label))


def phases_apart(phases: int, config: Config) -> list[int]:
    """Return the number of control periods from the developed wake to each starting phase, evenly over a cycle."""
    cycle = 1.0 / config.forcing.base_frequency
    return [round(number * cycle / phases / config.flow.control_period) for number in range(phases)]


def starting_states(
    folder: CampaignFolder | None,
    config: Config,
    phases: int,
    scenario: str = "",
    progress: Callable[[float, float], None] = lambda t, total: None,
) -> tuple[State, ...]:
    """Return the flow states of all starting phases, at time zero with the jets shut. If `folder` is None or lacks one
    of them, all are computed. For a body other than the truck this takes minutes, and `progress` is called with (time,
    total time) in t_c. `scenario` is empty for the common plant of the scenarios that have no plant of their own.
    Raises PlantError if there is no developed wake for the settings."""
    kept = [] if folder is None else [_kept(folder.start(number, scenario), config) for number in range(phases)]
    whole = [state for state in kept if state is not None]
    if len(whole) == phases:
        return tuple(whole)
    wake = TruckWake(config.flow, body=config.body)
    if config.body == TRUCK_BODY:
        wake.reset(replace(developed_state(), substep=0, action=0.0))
    else:
        develop(wake, progress=progress)
    states, done = [], 0
    for wanted in phases_apart(phases, config):
        for _ in range(wanted - done):
            wake.advance(0.0)
        done = wanted
        states.append(replace(wake.state(), substep=0, action=0.0))
    return tuple(states)


def keep_states(folder: CampaignFolder, states: Sequence[State], scenario: str = "") -> None:
    """Write the states of all starting phases to the files that `starting_states` reads."""
    for number, state in enumerate(states):
        save_state(folder.start(number, scenario), state)


def _kept(file: Path, config: Config) -> State | None:
    """Return the state in the file; None if it cannot be read, or is for another body or Reynolds number."""
    try:
        state = load_state(file)
        check_origin(state.origin, config.body, config.flow.reynolds)
    except PlantError:
        return None
    return state
