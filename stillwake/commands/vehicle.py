"""The command `stillwake vehicle`, which simulates the vehicle on an ECU's bus in real time."""

from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Final, Literal

import typer

from contract.config.loading import to_tree
from contract.config.tree import Config
from contract.errors import ConfigError
from contract.release.checks import Bundle
from contract.shipped import recording
from stillwake.console import options as shared
from stillwake.console.outputs import check_apart, check_frames, check_json, claim, save_json
from stillwake.console.progress import progress
from stillwake.console.settings import REAL_BUS, settings, with_bus
from stillwake.console.stopping import until_stopped
from stillwake.console.terminal import console, print_table
from stillwake.parts.releases import open_release
from stillwake.parts.wakes import driven_at

if TYPE_CHECKING:
    from collections.abc import Callable

    from firmware_sim.bench.real_time.running import Course
    from firmware_sim.bench.real_time.vehicle_loop import Pressures, VehicleFigures
    from wake.plant.drive import Drive

_USES: Final = ("body", "operating_point", "flow", *REAL_BUS, "bus.key", "ecu", "vehicle")

PlantName = Annotated[Literal["recording", "wake"], typer.Option("--plant", help="Only the wake responds to jets.")]


def vehicle(
    bundle: shared.Bundle = None,
    plant: PlantName = "recording",
    dataset: shared.DataSet = None,
    episode: Annotated[str | None, typer.Option(help="Episode of the recording; see above.")] = None,
    state: shared.State = None,
    drive: shared.Drive = None,
    lead_in: shared.LeadIn = 20.0,
    periods: shared.Periods = None,
    freshness: shared.Freshness = None,
    stage_times: shared.StageTimes = None,
    priority: shared.Priority = 50,
    frames: shared.Frames = None,
    json_file: shared.JsonFile = None,
    bus: shared.Bus = None,
    given: shared.Settings = [],  # noqa: B006
) -> None:
    """Simulate an ECU's vehicle on a bus in real time: send pressures in every control period, and follow the ECU's
    commands.

    By default the pressures come from a recorded episode; an episode with shut jets is preferred. Recorded pressures do
    not respond to the jets: the run shows whether bus and ECU meet their deadlines, but no drag reduction. With --plant
    wake the pressures come from a wake that is computed during the run, on a grid that is coarse enough for this
    computer, for example --set flow.refinement=0.75 --set flow.substeps=15. --state and --drive need --plant wake, and
    the drive begins when control is requested.

    At a quarter of the design speed, --set operating_point.speed=6.25, the wake is four times as slow and the control
    period is four times as long. The ECU then needs a bundle for this operating point (`bundle renew --set
    operating_point.speed=...`).

    --freshness is needed with bus.key: the file counts this node's power cycles.

    After Ctrl-C, SIGTERM, SIGHUP or the number of periods in --periods, the vehicle withdraws its request for control
    on the bus before the command ends. Exit status 3: no usable command was received. If the bus is lost, the command
    ends with one line and exit status 1, and does not open the bus again.
    """
    check_json(json_file, frames, stage_times, dataset, state)
    check_frames(frames)
    for path in filter(None, (stage_times, freshness)):
        claim(path)
    live = plant == shared.WAKE
    loaded = settings("vehicle", with_bus(bus, given), uses=_USES)
    key = loaded.config.bus.key
    check_apart(json_file, frames, stage_times, freshness, Path(key) if key else None)
    _check_plant(live=live, dataset=dataset, episode=episode, state=state, drive=drive)
    shared.steps_of("--lead-in", lead_in, loaded.config.flow.control_period)
    before_s = lead_in * loaded.config.operating_point.convective_time
    driven, config = driven_at(drive, loaded.config, after_s=before_s)
    release = open_release(bundle)

    from contract.recording.dataset import read
    from ecu.real_time.privileges import Wanted
    from firmware_sim.bench.real_time.running import Course
    from firmware_sim.bench.real_time.vehicle_loop import Replay

    course = Course(
        periods=periods,
        enable_after_s=before_s,
        stage_times=stage_times,
        freshness=freshness,
        frames=frames,
        wanted=Wanted(priority=priority),
        drive=driven,
    )

    def pressures(stack: ExitStack) -> "Pressures":
        if live:
            return _live(stack, config, state, driven)
        return Replay(read(recording() if dataset is None else dataset), episode)

    figures, described, is_stopped = _run(release, config, course, pressures)
    _print_figures(figures, "a live wake, which responds to the jets" if live else "recorded (open loop)")
    facts = {"bundle": release.digest, "pressures": described, "config": to_tree(config)}
    save_json(json_file, figures=figures.as_dict(), facts=facts, packages=("stillwake", "numpy", "python-can"))
    ended = "stopped" if is_stopped else "done"
    console.print(f"{ended}: the request for control is withdrawn, also on the bus, and the jets are shut")
    if is_stopped and periods is not None and figures.periods < periods:
        raise KeyboardInterrupt
    if figures.commands == 0:
        raise typer.Exit(3)


def _check_plant(*, live: bool, **given: object) -> None:
    for name in ("dataset", "episode") if live else ("state", "drive"):
        if given[name] is not None:
            why = "does not go with --plant wake" if live else "needs --plant wake: a recording cannot be changed"
            raise ConfigError(f"--{name} {given[name]}: {why}")


def _run(
    release: Bundle, config: Config, course: "Course", made: "Callable[[ExitStack], Pressures]"
) -> "tuple[VehicleFigures, str, bool]":
    """Simulate the vehicle until the last period or until the command is stopped. Return the figures, a description of
    the pressures, and whether the command was stopped."""
    from can_bridge.bus.backends.python_can import PythonCanBus
    from can_bridge.tools.measurement import live_log
    from ecu.fit import check_sensors
    from firmware_sim.bench.real_time.running import run_vehicle

    with ExitStack() as stack:
        keep = stack.enter_context(live_log(course.frames))
        bus = stack.enter_context(PythonCanBus.open(config.bus, keep=keep))
        _print_vehicle(config, release)
        pressures = made(stack)
        check_sensors(release, pressures.layout)
        console.print(pressures.description)
        is_stopped = stack.enter_context(until_stopped())
        with progress("periods") as report:

            def show(figures: "VehicleFigures") -> None:
                report("vehicle", figures.periods, course.periods, note_of(figures))

            sensors, tell = release.manifest.sensors, console.print
            figures = run_vehicle(
                bus, sensors, pressures, config, course, is_stopped=is_stopped, report=tell, progress=show
            )
            show(figures)
        return figures, pressures.description, is_stopped()


def note_of(figures: "VehicleFigures") -> str:
    """Describe the run's state for the progress line."""
    if figures.commands == 0:
        return "no usable command yet"
    mode = figures.latest_mode
    parts = [
        "" if mode is None else mode.name,
        f"age {figures.ages.quantile_ms(0.5):.1f} ms",
        f"misses {figures.misses}",
        f"action rms {figures.rms_action:.4f}",
    ]
    late = figures.left_out + figures.unsampled
    return "  ".join([part for part in parts if part] + ([f"late {late}"] if late else []))


def _print_vehicle(config: Config, release: Bundle) -> None:
    point, bus = config.operating_point, config.bus
    console.print(
        f"vehicle at {point.speed:g} m/s, control period {config.period_ns / 1e6:g} ms, "
        f"on {bus.interface} {bus.channel}"
    )
    built = release.manifest.operating_point
    if built != point:
        console.print(
            f"warning: bundle {release.manifest.name} is for {built.width:g} m, {built.speed:g} m/s, "
            f"{built.density:g} kg/m3: an ECU with it has another control period and other scales; `stillwake bundle "
            f"renew ... --set operating_point.speed={point.speed:g}` makes a bundle for this vehicle",
            style="yellow",
        )
    if (own := release.manifest.control_period) != config.flow.control_period:
        console.print(
            f"warning: bundle {release.manifest.name} is for a control period of {own:g} t_c, these settings have "
            f"{config.flow.control_period:g} t_c; a recording's rows follow at the settings' period",
            style="yellow",
        )


def _live(stack: ExitStack, config: Config, state: Path | None, drive: "Drive | None") -> "Pressures":
    from firmware_sim.bench.real_time.live_wake import LiveWake

    with progress("t_c") as report:

        def settling(t: float, total: float) -> None:
            report("wake settles on this grid", round(t, 1), total)

        wake = stack.enter_context(LiveWake(config, state, settling, drive))
    flow, speed = config.flow, wake.speed
    warning = speed.check(config.period_ns / 1e6, refinement=flow.refinement, substeps=flow.substeps)
    console.print(f"the wake takes {speed.typical_ms:.1f} ms for a control period, at worst {speed.worst_ms:.1f} ms")
    if warning is not None:
        console.print(warning, style="yellow")
    return wake


def _print_figures(figures: "VehicleFigures", pressures: str) -> None:
    modes = ", ".join(f"{mode.name} {count}" for mode, count in sorted(figures.modes.items())) or "none"

    def quantiles(times: Any) -> str:
        if figures.commands == 0 and times is figures.ages:
            return "none"
        return " / ".join(f"{times.quantile_ms(share):.2f}" for share in (0.5, 0.99, 1.0)) + " ms"

    rows = (
        ("pressures", pressures),
        ("periods", str(figures.periods)),
        ("of these skipped: the vehicle itself was late", str(figures.left_out)),
        ("of these without pressures: the live wake was late", str(figures.unsampled)),
        ("pressure frames that the bus refused", str(figures.unsent)),
        ("usable commands received", str(figures.commands)),
        ("misses: periods without a command, after the first", str(figures.misses)),
        ("commands for the period in which they arrived", str(figures.at_once)),
        ("age of the pressures at the command's arrival, p50 / p99 / max", quantiles(figures.ages)),
        ("lateness of the sampling, p50 / p99 / max", quantiles(figures.lateness)),
        ("action, rms / largest", f"{figures.rms_action:.4f} / {figures.largest:.4f} U_inf W"),
        ("modes of the ECU in the commands", modes),
    )
    print_table("vehicle", "", rows=rows)
