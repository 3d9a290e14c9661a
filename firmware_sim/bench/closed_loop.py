"""A closed-loop run under a bundle's controller, with its results in a run folder."""

import json
from collections.abc import Callable
from contextlib import AbstractContextManager, ExitStack
from pathlib import Path
from typing import Any

from can_bridge.wire.messages import Mode
from contract.atomic import replacing
from contract.config.tree import Config
from contract.release.checks import Bundle
from firmware_sim.bench.disturbances import Disturbances
from firmware_sim.bench.simulation import Simulation, Spans
from firmware_sim.runs import run_log, wake_stills
from firmware_sim.runs.control import mode_names
from firmware_sim.runs.metadata import RunOrigin
from firmware_sim.runs.run_log import Row, RunFolder, RunLog
from firmware_sim.runs.summary import whole_summary
from firmware_sim.runs.wake_stills import Scene, WakeRecorder
from wake.pictures.drawing import WakePicture
from wake.pictures.fields import LevelPicture
from wake.plant.protocol import LivePlant
from wake.plants import open_plant


def run_closed_loop(
    output: Path,
    bundle: Bundle,
    config: Config,
    spans: Spans,
    *,
    disturbances: Disturbances | None = None,
    origin: RunOrigin | None = None,
    ready: Callable[[int], None] = lambda total: None,
    progress: Callable[[Row, int, int], None] = lambda row, done, total: None,
    plant: AbstractContextManager[LivePlant] | None = None,
    progress_without: Callable[[int, int], None] = lambda done, total: None,
    report: Callable[[RunFolder], object] = lambda folder: None,
    **parts: Any,
) -> RunLog:
    """Run a wake under the bundle's controller and write the results to `output`. `Simulation` and `Simulation.run`
    explain the arguments that are not listed here, and the errors that they raise. Raises StillwakeError also if the
    folder cannot be written.

    Args:
        output: run folder (`firmware_sim.runs.run_log`), created if it does not exist. An earlier run in this folder
            is replaced when the new run is complete.
        plant: context manager that this function enters to get the wake; if None, the shipped wake in the built-in
            solver. With a drive, the flow's time steps (`config.flow`) must be short enough for the drive's speeds.
        report: called with the folder after all other files have been written; the function may write more files.
    """
    # This import takes a second, because python-can loads all its log writers. So the import is inside the function.
    from can_bridge.logs.candump_log import recording

    disturbances = Disturbances() if disturbances is None else disturbances
    simulation = Simulation(bundle, config, spans=spans, disturbances=disturbances, **parts)
    with ExitStack() as stack:
        # The output folder appears only if the block succeeds, so it never contains an incomplete run.
        folder = RunFolder(stack.enter_context(replacing(output, keep=True)))
        folder.path.mkdir()
        frames = stack.enter_context(ExitStack())
        capture = frames.enter_context(recording(folder.frames))
        wake = stack.enter_context(open_plant("wake", output, disturbances.plant(config)) if plant is None else plant)
        picture = LevelPicture(wake)
        recorder = WakeRecorder(Scene.of(picture, wake.layout), simulation.periods[1])

        def begin(total: int) -> None:
            ready(total)
            recorder.record(0, wake.t, picture.levels)

        def record(row: Row, done: int, total: int) -> None:
            # The wake is now at the start of the next period. Its picture is recorded unless the run has ended.
            if done < total:
                recorder.record(done, wake.t, picture.levels)
            progress(row, done, total)

        log = simulation.run(
            wake,
            capture=capture,
            origin=origin,
            ready=begin,
            requesting=lambda: _draw(wake, bundle, "without control", folder.uncontrolled_picture),
            progress=record,
            progress_without=progress_without,
        )
        ended = "under control" if mode_names(log)[-1] == Mode.CONTROL.name else "at the end"
        _draw(wake, bundle, ended, folder.controlled_picture)
        wake_stills.save(folder.wake, recorder.recorded())
        run_log.save(folder.series, log)
        folder.summary.write_text(json.dumps(whole_summary(log), indent=2) + "\n", encoding="utf-8")
        frames.close()
        report(folder)
    return log


def _draw(wake: LivePlant, bundle: Bundle, state: str, target: Path) -> None:
    picture = WakePicture(wake, "vorticity", bundle.manifest.sensors)
    picture.update(f"{state}, t = {wake.t:.1f} $t_c$").savefig(target, format="png")
