"""The periods that are kept as a run folder, as `stillwake run` would have written it; whole or not at all.

Times are those of the loop: a run whose beginning is no longer kept does not begin at 0.
"""

import json
import pickle
from collections.abc import Sequence
from datetime import date
from pathlib import Path
from typing import Final

from can_bridge.wire.message_sets import message_set
from contract.atomic import replacing
from contract.config.tree import Config
from contract.release.checks import Bundle
from firmware_sim.bench.spans import CYCLES, SHEDDING_TIME
from firmware_sim.live.loop.kept import Counted, KeptPeriod
from firmware_sim.live.loop.live_run import LiveRun
from firmware_sim.live.loop.scene import draw
from firmware_sim.runs import run_log, wake_stills
from firmware_sim.runs.bus_traffic import BusTraffic, NodeErrors
from firmware_sim.runs.metadata import InjectedFault, RunEcu, RunMetadata, RunOrigin
from firmware_sim.runs.run_folder import RunFolder
from firmware_sim.runs.run_log import BusTotals, RunLog
from firmware_sim.runs.run_page.report import write_report
from firmware_sim.runs.summary import whole_summary

_SETTLE: Final = 40.0
"""t_c that controlled averages leave out where there is time enough: what `stillwake run` does."""


def save(target: Path, run: LiveRun, bundle: Bundle, config: Config, *, seed: int, origin: RunOrigin) -> None:
    """Write the periods of a run that are kept, at least one.

    Args:
        target: the folder.
        run: to be saved.
        bundle, config: of the session.
        seed: of what was drawn.
        origin: day and command.

    Raises:
        StillwakeError: if the folder cannot be written.
    """
    # python-can loads all that it can write with, which takes a second.
    from can_bridge.logs import frame_log

    log = run_log_of(run, bundle, config, seed=seed, origin=origin)
    periods, sensors = list(run.periods), bundle.manifest.sensors
    with replacing(target) as temporary:
        temporary.mkdir()
        folder = RunFolder(temporary)
        run_log.save(folder.series, log)
        with frame_log.recording(folder.frames) as append:
            for period in periods:
                for frame in pickle.loads(period.frames):
                    append(frame)
        folder.summary.write_text(json.dumps(whole_summary(log), indent=2) + "\n", encoding="utf-8")
        last, requested = run.scene.still(), run.request.first is not None
        before = run.before_control if requested else last
        draw(before, sensors, "without control", folder.uncontrolled_picture)
        draw(last, sensors, "under control" if requested else "never under control", folder.controlled_picture)
        stills = run.scene.recorded(periods[0].k)
        if stills is not None:
            with replacing(folder.wake) as file:
                wake_stills.save(file, stills)
        write_report(folder)


def run_log_of(run: LiveRun, bundle: Bundle, config: Config, *, seed: int, origin: RunOrigin) -> RunLog:
    """The series and facts of the periods that are kept."""
    periods, end = list(run.periods), run.counted()
    first = periods[0]
    enabled = next((place for place, period in enumerate(periods) if period.requested), len(periods))
    metadata = RunMetadata.of(
        bundle,
        config,
        settle=_settle((len(periods) - enabled) * config.flow.control_period),
        averages=True,
        status=run.ecu.ecu.status(),
        plant=run.wake.description,
        computed_by=_computed_by(run, first.k),
        ecu=RunEcu.of(run.ecu.kind, run.ecu.clock_mhz, [p.planned_ns for p in periods if p.planned_ns is not None]),
        origin=origin,
        calibration=run.ecu.ecu.calibration,
        faults=_faults(run, first),
        fault_seed=seed,
    )
    return RunLog.of(
        [period.row for period in periods],
        enabled,
        _totals(first.before.bus, end.bus),
        metadata,
        run.wake.layout,
        traffic=_traffic(periods, end, config, run.errors()),
    )


def _settle(controlled: float) -> float:
    """t_c to be left out of so many under control: as much as leaves the averages their cycles."""
    return min(_SETTLE, max(0.0, round(controlled - CYCLES * SHEDDING_TIME, 9)))


def _computed_by(run: LiveRun, first: int) -> str:
    """What computed in the periods from `first` on, with its times in s of the run."""
    begun = [item for item in run.changes if item.k <= first]
    later = [item for item in run.changes if item.k > first]
    parts = [*(item.text for item in begun[-1:]), *(f"from {run.time_s(item.k):g} s {item.text}" for item in later)]
    return "; ".join(parts)


def _faults(run: LiveRun, first: KeptPeriod) -> tuple[InjectedFault, ...]:
    acted = first.before.acted
    return tuple(one.injected(run.period_ns, acted.get(one.serial, 0)) for one in run.disturbances.happened)


def _totals(begin: BusTotals, end: BusTotals) -> BusTotals:
    return BusTotals(
        sent=end.sent - begin.sent,
        # A frame that was under way at the beginning is not lost any more when it has arrived.
        lost=max(end.lost - begin.lost, 0),
        # An ECU that starts again counts from 0.
        rejected=max(end.rejected - begin.rejected, 0),
    )


def _traffic(periods: Sequence[KeptPeriod], end: Counted, config: Config, nodes: dict[str, NodeErrors]) -> BusTraffic:
    begin, last = periods[0].before.activity, end.activity
    longest: dict[int, int] = {}
    for period in periods:
        longest |= {sent: max(waited, longest.get(sent, 0)) for sent, waited in period.waits_ns.items()}
    names = {spec.frame_id: spec.name for spec in message_set(config.bus).specs}
    passed_ns = last.now_ns - begin.now_ns
    return BusTraffic(
        load=min((last.busy_ns - begin.busy_ns) / passed_ns, 1.0),
        frames=last.frames - begin.frames,
        error_frames=last.error_frames - begin.error_frames,
        longest_wait_ms={name: longest[frame_id] / 1e6 for frame_id, name in names.items() if frame_id in longest},
        nodes=nodes,
    )


def origin_of(day: date, command: tuple[str, ...], first: int) -> RunOrigin:
    """Origin of a session; `first` is the first period that is kept."""
    if first == 0:
        return RunOrigin.on(day, command=command)
    return RunOrigin.on(day, command=command, start=f"period {first} of a live session")
