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


def run_closed_loop(
    output: Path,
    bundle: Bundle,
    config: Config,
    spans: Spans,
    *,
    plant: AbstractContextManager[LivePlant],
    origin: RunOrigin | None = None,
    ready: Callable[[int], None] = lambda total: None,
    progress: Callable[[Row, int, int], None] = lambda row, done, total: None,
    progress_without: Callable[[int, int], None] = lambda done, total: None,
    report: Callable[[RunFolder], object] = lambda folder: None,
    **parts: Any,
) -> RunLog:
    """Run the wake that `plant` opens under the bundle's controller. Write the results to `output`, a `RunFolder`; an
    earlier run in this folder is replaced when the new run is complete. With a drive, the time steps in `config.flow`
    must be short enough for the drive's speeds. `report` is called with the folder after all other files have been
    written, and may write more files. `Simulation` and `Simulation.run` explain the other arguments, and the errors
    that they raise. Raises StillwakeError also if the folder cannot be written."""
    # This import takes a second, because python-can loads all its log writers. So the import is inside the function.
    from can_bridge.logs.candump_log import recording

    simulation = Simulation(bundle, config, spans=spans, **parts)
    with ExitStack() as stack:
        # The output folder appears only if the block succeeds, so it never contains an incomplete run.
        folder = RunFolder(stack.enter_context(replacing(output, keep=True)))
        folder.path.mkdir()
        wake = stack.enter_context(plant)
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

        with recording(folder.frames) as capture:
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
        report(folder)
    return log


def _draw(wake: LivePlant, bundle: Bundle, state: str, target: Path) -> None:
    picture = WakePicture(wake, "vorticity", bundle.manifest.sensors)
    picture.update(f"{state}, t = {wake.t:.1f} $t_c$").savefig(target, format="png")
