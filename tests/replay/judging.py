"""What a change did: both ECUs open loop over recorded drives, and their answers beside the recorded ones."""

from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import zip_longest
from pathlib import Path
from typing import Any, Final

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
from export.release.lowering import int8_library
from export.release.pipeline import calibration_windows
from export.to_c.estimator import estimator_files
from tests.replay.recording import open_loop, python_ecu, shipped, vehicle
from tests.replay.shelf import Answers, read

FLAGS: Final = ("-O1", "-ffp-contract=off")
"""Compiled in a third of the time, and to the bit the same: nothing is contracted."""
ROUNDING: Final = 1e-3
"""U_inf W, 1.3 % of the jets' range. ONNX Runtime sums in another order on another processor or in another version:
there commands of the ECU in Python are held to this, modes and reasons as they stand, and its state is not compared."""
MOST_DRAWN: Final = 12
"""Answers in a picture: nobody looks at more."""


@dataclass(frozen=True, kw_only=True)
class Verdict:
    """One drive by one ECU.

    Attributes:
        periods: in which its frames, or its state afterwards, are others.
        largest: change of a command, U_inf W.
        changed: fields of the state, in the order in which they change.
    """

    drive: str
    kind: str
    old: Answers
    new: Answers
    periods: list[int]
    largest: float
    changed: list[str]


def verdict(drive: str, kind: str, old: Answers, new: Answers, *, exact: bool = True) -> Verdict:
    """Compare two answers; a period or a field that one of them lacks differs. Without `exact` as `ROUNDING` says."""
    apart = [abs(one - other) for one, other in zip(old.actions, new.actions, strict=False)]
    differs = [one != other for one, other in zip_longest(old.frames, new.frames)]
    began = dict[str, int]()
    if exact:
        for name in old.states.keys() | new.states.keys():
            pairs = zip_longest(old.states.get(name, ()), new.states.get(name, ()))
            if other := {k for k, (one, two) in enumerate(pairs) if one != two}:
                began[name] = min(other)
                differs = [is_other or k in other for k, is_other in enumerate(differs)]
    else:
        shown = zip_longest(zip(old.modes, old.reasons, strict=True), zip(new.modes, new.reasons, strict=True))
        far = {k for k, change in enumerate(apart) if change > ROUNDING}
        differs = [one != two or k in far for k, (one, two) in enumerate(shown)]
    return Verdict(
        drive=drive,
        kind=kind,
        old=old,
        new=new,
        periods=[k for k, is_other in enumerate(differs) if is_other],
        largest=max(apart, default=0.0),
        changed=sorted(began, key=lambda name: (began[name], name)),
    )


def c_library() -> dict[str, bytes]:
    """The shipped release in C, without a vehicle's settings; other tests hold its gates."""
    release = shipped()
    program = program_of(model_folder.read(model()), release.manifest.mpc)
    episodes = dataset.read(recording())
    windows = calibration_windows(program, episodes.with_role("train"), episodes.layout)
    return int8_library(program, windows) | control_sources() | estimator_files(release.files[ESTIMATOR])


@dataclass(frozen=True, kw_only=True)
class Job:
    """Drives for one ECU in one process; all by the same build if it is the one in C, whose sources these are."""

    paths: Sequence[Path]
    kind: str = "python"
    sources: Mapping[str, bytes] | None = None


def c_jobs(paths: Sequence[Path], library: Mapping[str, bytes]) -> tuple[list[Job], dict[str, str]]:
    """The work of the ECU in C, and why it refuses a drive, by the drives' names."""
    groups, refused = defaultdict[bytes, list[Path]](list), dict[str, str]()
    for path in paths:
        drive = read(path)
        with vehicle(drive.settings) as config:
            try:
                groups[ecu_settings(shipped(), config)].append(path)
            except ConfigError as error:
                refused[drive.name] = str(error)
    of = {header: with_layout({**library, ECU_SETTINGS: header}) for header in groups}
    return [Job(paths=found, kind="c", sources=of[header]) for header, found in groups.items()], refused


def answers(job: Job) -> list[tuple[str, str, Answers]]:
    """(drive, ECU, what it answers) of a job."""
    in_c, found = None if job.sources is None else CEcu(job.sources, flags=FLAGS), []
    for path in job.paths:
        drive = read(path)
        with vehicle(drive.settings) as config:
            ecu = python_ecu(config) if in_c is None else in_c
        found.append((drive.name, job.kind, open_loop(ecu, drive.periods)))
    return found


def draw(verdicts: Sequence[Verdict], path: Path) -> None:
    """Draw recorded and present commands and operating modes over time, the largest changes first."""
    chosen = sorted(verdicts, key=lambda one: -one.largest)[:MOST_DRAWN]
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
