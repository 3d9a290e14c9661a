"""The effect of a change: both ECUs run open loop over recorded drives, and answers are compared with recorded ones."""

from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import zip_longest
from pathlib import Path
from typing import Any, Final, NamedTuple

import numpy as np
from matplotlib.figure import Figure

from can_bridge.wire.messages import Mode
from contract.atomic import replacing
from contract.controller.c_folder import ECU_SETTINGS
from contract.controller.estimator import ESTIMATOR
from contract.controller.image_payload import with_layout
from contract.errors import ConfigError
from contract.model import model_folder
from contract.recording import dataset
from contract.shipped import model, recording
from ecu.c.sources import control_sources
from ecu.in_c.c_ecu import CEcu
from ecu.in_c.c_settings import ecu_settings
from export.program.controller_program import program_of
from export.release.pipeline import calibration_windows
from export.to_c.estimator import estimator_files
from export.to_c.library import int8_library
from tests.replay.recording import open_loop, python_ecu, shipped, vehicle
from tests.replay.shelf import Answers, read

FLAGS: Final = ("-O1", "-ffp-contract=off")
"""They compile in a third of the time, and results are equal bit for bit, because nothing is contracted."""
ROUNDING: Final = 1e-3
"""Largest difference of commands of the ECU in Python, in U_inf W (1.3 % of the range), where another processor or
ONNX Runtime sums in another order. Modes and reasons must be equal there; the state is not compared."""


@dataclass(frozen=True)
class Verdict:
    """The comparison of one drive of one ECU: the periods in which frames or state differ, the largest change of a
    command in U_inf W, and the names of the state's changed fields in the order in which they change."""

    drive: str
    kind: str
    old: Answers
    new: Answers
    periods: list[int]
    largest: float
    changed: list[str]


def verdict(drive: str, kind: str, old: Answers, new: Answers, *, exact: bool = True) -> Verdict:
    """Compare two answers; what is missing in one differs. Without `exact` commands may differ by `ROUNDING`."""
    apart = [abs(one - other) for one, other in zip(old.actions, new.actions, strict=False)]
    began = dict[str, int]()
    if exact:
        differ = _unequal(old.frames, new.frames)
        for name in old.states.keys() | new.states.keys():
            if unequal := _unequal(old.states.get(name, ()), new.states.get(name, ())):
                began[name] = min(unequal)
                differ |= unequal
    else:
        differ = {k for k, change in enumerate(apart) if change > ROUNDING}
        differ |= _unequal(old.modes, new.modes) | _unequal(old.reasons, new.reasons)
    changed = sorted(began, key=lambda name: (began[name], name))
    return Verdict(drive, kind, old, new, periods=sorted(differ), largest=max(apart, default=0.0), changed=changed)


def _unequal(ones: Sequence[object], others: Sequence[object]) -> set[int]:
    return {k for k, (one, other) in enumerate(zip_longest(ones, others)) if one != other}


def c_library() -> dict[str, bytes]:
    """Return the shipped release in C, without a vehicle's settings. Other tests check its gates."""
    release = shipped()
    program = program_of(model_folder.read(model()), release.manifest.mpc)
    episodes = dataset.read(recording())
    windows = calibration_windows(program, episodes.with_role("train"), episodes.layout)
    return int8_library(program, windows) | control_sources() | estimator_files(release.files[ESTIMATOR])


class Job(NamedTuple):
    """Drives for one ECU in one process. For the ECU in C, `sources` build it, and all drives use this one build."""

    paths: Sequence[Path]
    sources: Mapping[str, bytes] | None = None


def c_jobs(paths: Sequence[Path], library: Mapping[str, bytes]) -> tuple[list[Job], dict[str, str]]:
    """Return the jobs of the ECU in C, and its reasons for refusing a drive, by the drive's name."""
    groups, refused = defaultdict[bytes, list[Path]](list), dict[str, str]()
    for path in paths:
        drive = read(path)
        with vehicle(drive.settings) as config:
            try:
                groups[ecu_settings(shipped(), config)].append(path)
            except ConfigError as error:
                refused[drive.name] = str(error)
    of = {header: with_layout({**library, ECU_SETTINGS: header}) for header in groups}
    return [Job(found, of[header]) for header, found in groups.items()], refused


def answers(job: Job) -> list[tuple[str, str, Answers]]:
    kind, in_c = ("python", None) if job.sources is None else ("c", CEcu(job.sources, flags=FLAGS))
    found = []
    for path in job.paths:
        drive = read(path)
        with vehicle(drive.settings) as config:
            ecu = in_c or python_ecu(config)
        found.append((drive.name, kind, open_loop(ecu, drive.periods)))
    return found


def draw(verdicts: Sequence[Verdict], path: Path) -> None:
    """Draw recorded and present commands and modes over time, the drives with the largest changes first."""
    chosen = sorted(verdicts, key=lambda one: -one.largest)[:12]
    figure = Figure(figsize=(12, 2.2 * len(chosen)), layout="constrained")
    axes: Any = figure.subplots(len(chosen), 2, squeeze=False)
    for (commands, modes), one in zip(axes, chosen, strict=True):
        for found, label, style in ((one.old, "recorded", "-"), (one.new, "now", "--")):
            commands.step(np.arange(len(found.actions)), found.actions, style, where="post", label=label)
            modes.step(np.arange(len(found.modes)), found.modes, style, where="post")
        commands.set_title(f"{one.drive}, {one.kind}: command in U_inf W by control period", fontsize="small")
        modes.set_title(f"operating mode; {len(one.periods)} periods differ", fontsize="small")
        modes.set_yticks([mode.value for mode in Mode], [mode.name for mode in Mode], fontsize="x-small")
        commands.legend(fontsize="x-small")
    with replacing(path) as temporary:
        figure.savefig(temporary, format="png")
