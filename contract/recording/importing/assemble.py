"""The import of a data set from files, one file per episode. All files are checked before the data set is written."""

import hashlib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

import numpy as np

from contract.arrays import Array
from contract.errors import DatasetError
from contract.recording.dataset import CP_QUANTUM, Dataset, Episode, Role
from contract.recording.episode import REQUIRED, UNITS, PlantFacts
from contract.recording.findings import LIMIT_TOLERANCE, STEP_TOLERANCE, clock_problem
from contract.recording.importing.forces import FORCE_COLUMNS
from contract.recording.importing.openfoam import case_of, read_case
from contract.recording.importing.source_file import Contents, Reference, read_source
from contract.recording.importing.stored import GAP, INITIAL_ACTION
from contract.sensor_layout import SensorLayout

_SERIES: Final = tuple(name for name in UNITS if name != "Cp")
_LARGEST: Final = 127.0
"""Largest magnitude of a coefficient that fits into the data set's format. Most pressures in Pa are larger."""


@dataclass(frozen=True, kw_only=True)
class EpisodeSource:
    """A file and the role of its episode. The episode's name is `named`; by default, the file's name without its
    suffix, or the folder of an OpenFOAM case. `made` has contents that were computed before the import, from a part of
    a log and a table of forces. `provenance` has further facts, stored with the file's name and hash."""

    path: Path
    role: Role
    named: str = ""
    made: Contents | None = None
    provenance: Mapping[str, Any] = field(default_factory=dict)

    @property
    def name(self) -> str:
        case = None if self.named else case_of(self.path)
        return self.named or (self.path.stem if case is None else case.name)


def assemble(
    sources: Sequence[EpisodeSource],
    layout: SensorLayout,
    facts: PlantFacts,
    *,
    references: Mapping[str, Reference] | None = None,
    renamed: Mapping[str, str] | None = None,
    progress: Callable[[Path], None] = lambda path: None,
    told: Callable[[Path, str], None] = lambda path, note: None,
) -> Dataset:
    """Read every file into an episode. Raises DatasetError if a file cannot be read or does not fit; the message states
    the file, the place and the allowed values.

    Args:
        facts: facts about the plant; control period and action limit must be known.
        references: values in the files that equal 1 in the data set, by series or sensor.
        renamed: names of series and sensors in the files, by their names in the data set.
        progress: called with every file before the file is read.
        told: called with a file and a note on the file, such as the names that are neither series nor sensors.
    """
    renamed, references = dict(renamed or {}), dict(references or {})
    if facts.control_period is None or facts.action_limit is None:
        raise DatasetError("control period and action limit must be given: the files do not state them")
    if "Cp" in references and references["Cp"].number < 0.0:
        raise DatasetError(f"{references['Cp'].option}: a dynamic pressure must be positive")
    for name, reference in references.items():
        if name not in FORCE_COLUMNS and all(source.made is not None for source in sources):
            raise DatasetError(f"{reference.option}: has no effect on a log, because its messages have units")
    if not sources:
        raise DatasetError("no data file is given: name at least one file for training and one for the test")
    _check_names(sources)
    known = (*_SERIES, "Cp", *layout.names, INITIAL_ACTION)
    options = {name: f"--map {name}={inside}" for name, inside in renamed.items()}
    for name, option in (*options.items(), *((name, one.option) for name, one in references.items())):
        if name not in known:
            series = ", ".join((*_SERIES, "Cp"))
            raise DatasetError(f"{option}: {name!r} is neither a series nor a sensor; the series are {series}")
    episodes, used = [], set[str]()
    for source in sources:
        contents = source.made
        if contents is None:
            progress(source.path)
            case = case_of(source.path)
            if case is None:
                contents = read_source(source.path, layout, (*_SERIES, INITIAL_ACTION), renamed, references)
            else:
                contents = read_case(source.path, case, layout, facts.control_period, renamed, references)
        episodes.append(_episode(source, contents, layout, facts, references if source.made is None else {}))
        used |= contents.renamed
        for note in ([f"not used: {', '.join(contents.unread)}"] if contents.unread else []) + list(contents.notes):
            told(source.path, note)
    for name in renamed:
        if name not in used:
            raise DatasetError(f"--map {name}={renamed[name]}: no file has a column {renamed[name]!r}")
    return Dataset(episodes=tuple(episodes), layout=layout, facts=facts)


def _check_names(sources: Sequence[EpisodeSource]) -> None:
    names = [source.name for source in sources]
    paths = [source.path for source in sources if source.made is None]
    for source in sources:
        if paths.count(source.path) > 1:
            remedy = "an episode has one role: if you have no other file, cut it in two"
            raise DatasetError(f"{source.path}: given twice; {remedy}")
        if names.count(source.name) > 1:
            which = f"two files would make an episode called {source.name!r}"
            raise DatasetError(f"{source.path}: {which}: rename one of them")


def _episode(
    source: EpisodeSource,
    contents: Contents,
    layout: SensorLayout,
    facts: PlantFacts,
    references: Mapping[str, Reference],
) -> Episode:
    path, arrays, period, limit = source.path, contents.arrays, facts.control_period, facts.action_limit
    assert period is not None
    assert limit is not None
    # In a CSV file the initial action is a column; only its first row is used.
    initial = float(np.ravel(arrays.pop(INITIAL_ACTION, np.zeros(1)))[0])
    for name in REQUIRED:
        if name not in arrays and name != "t":
            raise DatasetError(f"{path}: no column {name!r}; if the column has another name, use --map {name}=NAME")
    steps = len(arrays["action"])
    if steps == 0:
        raise DatasetError(f"{path}: holds no control step")
    arrays.setdefault("t", period * np.arange(steps, dtype=np.float64))
    _check_shapes(path, arrays, steps, len(layout))
    _check_clock(path, arrays["t"], period)
    _check_action(path, np.append(initial, arrays["action"]), limit)
    _check_size(path, arrays, layout, is_divided="Cp" in references)
    digest = hashlib.sha256(b"".join(file.read_bytes() for file in contents.files)).hexdigest()
    provenance: dict[str, Any] = {"source": path.name, "source_sha256": digest}
    if references:
        provenance["references"] = {name: [one.number, one.unit] for name, one in references.items()}
    provenance |= source.provenance
    series = {name: arrays[name] for name in UNITS if name in arrays}
    return Episode(name=source.name, role=source.role, series=series, initial_action=initial, provenance=provenance)


def _check_shapes(path: Path, arrays: Mapping[str, Array], steps: int, sensors: int) -> None:
    for name, array in arrays.items():
        expected = (steps, sensors) if name == "Cp" else (steps,)
        if array.shape != expected:
            hint = ": transpose it" if name == "Cp" and array.shape == expected[::-1] else ""
            raise DatasetError(f"{path}: {name!r} has shape {array.shape}, must be {expected}, like action{hint}")


def _check_clock(path: Path, t: Array, period: float) -> None:
    problem = clock_problem(t, period)
    if problem is None:
        return
    if (np.diff(t) <= 0).any():
        raise DatasetError(f"{path}: {problem}{'; some rows occur twice' if (np.diff(t) == 0).any() else ''}")
    mean = float((t[-1] - t[0]) / (len(t) - 1))
    finer = round(period / mean)
    if finer >= 2 and abs(finer * mean / period - 1.0) < 0.01:
        problem = (
            f"t rises by {mean:.6g}, but the control period is {period:g}: {finer} samples per period. Keep one row of "
            f"{finer}, so that row k has the pressures at t_k and the action commanded then"
        )
    ratio = f"{mean / period:.4g}"
    hint = f"if t is in s or ms, and W / U_inf is {ratio} in that unit, import with --reference t={ratio}"
    hint = f"; t and flow.control_period are in W / U_inf: {hint}" if abs(mean / period - 1.0) > STEP_TOLERANCE else ""
    raise DatasetError(f"{path}: {problem}{hint}")


def _check_action(path: Path, actions: Array, limit: float) -> None:
    largest = int(np.abs(actions).argmax())
    if abs(actions[largest]) > limit * (1.0 + LIMIT_TOLERANCE):
        found = f"{actions[largest]:g} {f'at step {largest - 1}' if largest else 'before the first row'}"
        raise DatasetError(
            f"{path}: action is {found}, beyond flow.action_limit = {limit:g}; "
            f"an action is the jets' flow rate in U_inf W, not a percentage; --reference action=NUMBER gives "
            f"the number in the file that means 1 U_inf W"
        )


def _check_size(path: Path, arrays: Mapping[str, Array], layout: SensorLayout, *, is_divided: bool) -> None:
    for name, array in arrays.items():
        peak = float(np.abs(array).max())
        if name not in ("t", "action") and peak > _LARGEST:
            beyond = np.abs(array) > _LARGEST
            hint = "; if it is in Pa, give rho U_inf^2 / 2 as in --reference Cp=240Pa" if name == "Cp" else ""
            if name == "Cp" and is_divided:
                hint = "; pressures must be p - p_inf, not absolute, and in the unit of the option"
            if name in ("Cd", "Cl"):
                hint = f"; if it is in N, give the force in the file that means 1 as in --reference {name}=40N"
            if 2 * beyond.sum() < beyond.size:
                k = tuple(np.argwhere(beyond)[0])
                hint = f"; {array[k]:g}, first at step {k[0]}, may stand for a missing value{GAP}"
            raise DatasetError(f"{path}: {name!r} reaches {peak:g}; a coefficient stays below {_LARGEST:g}{hint}")
    # Constant sensors are reported elsewhere. They are found by their range; rounding may make their deviation nonzero.
    spread = np.where(np.ptp(arrays["Cp"], axis=0) > 0.0, arrays["Cp"].std(axis=0), np.inf)
    weakest = int(spread.argmin())
    if spread[weakest] < CP_QUANTUM:
        raise DatasetError(
            f"{path}: sensor {layout.names[weakest]} varies by {spread[weakest]:.2g}, less than the {CP_QUANTUM:.2g} "
            f"that a data set resolves; correct --reference Cp, or, if the sensor is dead, remove it from the list"
        )
