"""The command that is the other side of an ECU's bus, in real time."""

from contextlib import ExitStack
from dataclasses import replace
from math import isfinite
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Final

import typer

from contract.config.loading import to_tree
from contract.config.tree import Config
from contract.errors import ConfigError
from contract.release.checks import Bundle
from contract.results import versions
from stillwake.console.bus_option import BusName, with_bus
from stillwake.console.claims import claim
from stillwake.console.outputs import check_json, save_json
from stillwake.console.settings import REAL_BUS, settings
from stillwake.console.stopping import until_stopped
from stillwake.console.terminal import ConfigFile, JsonFile, Overrides, console, print_table, progress_bar
from stillwake.parts.releases import Trust, open_release

if TYPE_CHECKING:
    from firmware_sim.bench.real_time.pressures import Pressures
    from firmware_sim.bench.real_time.vehicle_counts import Figures
    from wake.plant.drive import Drive

NO_COMMANDS: Final = 3
"""Exit status of a run in which no usable command came."""
_USES: Final = ("body", "operating_point", "flow", *REAL_BUS, "bus.key", "ecu", "vehicle")


def vehicle(
    bundle: Annotated[
        Path | None, typer.Option(help="Release bundle that names the sensors; default: the shipped one.")
    ] = None,
    trust: Trust = None,
    dataset: Annotated[
        Path | None, typer.Option(help="Recording to replay; default: the shipped one.", metavar="FILE")
    ] = None,
    episode: Annotated[
        str | None, typer.Option(help="Episode of it; default: one with the jets at rest, if there is one.")
    ] = None,
    begin: Annotated[float, typer.Option("--from", help="Where in the episode to begin, t_c.", min=0.0)] = 0.0,
    live: Annotated[
        bool, typer.Option("--live", help="A live wake, which answers the jets, and no recording.")
    ] = False,
    start: Annotated[
        Path | None, typer.Option(help="With --live: flow state to begin from (`develop`).", metavar="FILE")
    ] = None,
    drive: Annotated[
        str | None,
        typer.Option(
            metavar="NAME|FILE.csv", help="With --live: speeds from when control is wanted on, as of `run --drive`."
        ),
    ] = None,
    slow_down: Annotated[
        float, typer.Option(help="Divide the vehicle's speed: periods take so many times as long.", min=1.0)
    ] = 1.0,
    periods: Annotated[
        int | None, typer.Option(help="End after so many control periods; default: on Ctrl-C or SIGTERM.", min=1)
    ] = None,
    enable_after: Annotated[float, typer.Option(help="Seconds until control is wanted.", min=0.0)] = 2.0,
    freshness: Annotated[
        Path | None, typer.Option(help="With bus.key: file that counts this node's power cycles.", metavar="FILE")
    ] = None,
    stage_times: Annotated[
        Path | None, typer.Option(help="Write the instants of every period's stages (.npz).", metavar="FILE")
    ] = None,
    priority: Annotated[int, typer.Option(help="Of SCHED_FIFO, 1 to 99; 0: an ordinary process.", min=0, max=99)] = 50,
    processor: Annotated[int | None, typer.Option(help="Run on this processor alone.", min=0)] = None,
    json_file: JsonFile = None,
    bus_name: BusName = None,
    config_file: ConfigFile = None,
    overrides: Overrides = [],  # noqa: B006
) -> None:
    """Be the vehicle of an ECU on a bus, in real time: send pressures every control period, obey its commands.

    The pressures are a recording's, and do not answer the jets: whether bus and
    ECU keep their times can be seen, but no drag reduction. With --live they
    are of a wake that is computed meanwhile, on a grid on which this computer
    keeps up, for example --set flow.refinement=0.75 --set flow.substeps=15.

    --slow-down 4 makes it a vehicle of a quarter of the speed, whose wake and
    control period are four times as slow. Its ECU needs a bundle of that
    operating point (`bundle renew --set operating_point.speed=...`).

    Ctrl-C, SIGTERM and --periods end it well: the request for control is
    withdrawn on the bus. Exit status 3: no usable command came.
    A lost bus ends it with one line and exit status 1: it is not opened again.
    """
    check_json(json_file)
    if stage_times is not None:
        claim(stage_times)
    loaded = settings("vehicle", config_file, with_bus(bus_name, overrides), uses=_USES)
    config = slowed(loaded.config, slow_down)
    for option, given in {"--dataset": dataset, "--episode": episode, "--from": begin or None}.items():
        if live and given is not None:
            raise ConfigError(f"{option} {given}: of a recording; does not go with --live")
    if start is not None and not live:
        raise ConfigError(f"--start {start}: where a live wake begins; needs --live")
    if drive is not None and not live:
        raise ConfigError(f"--drive {drive}: a recording has one speed; needs --live")
    if not isfinite(enable_after):
        raise ConfigError(f"--enable-after {enable_after}: must be a number of seconds")
    driven = None
    if drive is not None:
        from wake.plant.drive import find_drive

        driven = find_drive(drive, config.operating_point).after(enable_after)
        config = replace(config, flow=driven.substeps(config.flow, config.operating_point))
    release = open_release(bundle, trust)

    from can_bridge.bus.backends.python_can import PythonCanBus
    from firmware_sim.bench.real_time.running import Course, run_vehicle
    from firmware_sim.ecu.fit import check_sensors
    from firmware_sim.ecu.real_time.privileges import Wanted

    course = Course(
        periods=periods,
        enable_after_s=enable_after,
        stage_times=stage_times,
        freshness=freshness,
        wanted=Wanted(priority=priority, processor=processor),
        drive=driven,
    )
    with ExitStack() as stack:
        bus = stack.enter_context(PythonCanBus.open(config.bus))
        _print_vehicle(config, release)
        pressures = _live(stack, config, start, driven) if live else _replay(config, dataset, episode, begin)
        check_sensors(release, pressures.layout)
        console.print(pressures.description)
        is_stopped = stack.enter_context(until_stopped())
        with progress_bar("periods") as bar:
            task = bar.add_task("vehicle", total=periods, note="")

            def show(figures: "Figures") -> None:
                bar.update(task, completed=figures.periods, note=note_of(figures))

            figures = run_vehicle(
                bus,
                release.manifest.sensors,
                pressures,
                config,
                course,
                is_stopped=is_stopped,
                report=bar.console.print,
                progress=show,
            )
            bar.update(task, completed=figures.periods, note=note_of(figures))
        was_cut_short = is_stopped() and periods is not None and figures.periods < periods
    _print_figures(figures, "a live wake, which answers the jets" if live else "recorded (open loop)")
    facts = {
        "bundle": release.digest,
        "pressures": pressures.description,
        "config": to_tree(config),
        "versions": versions("stillwake", "numpy", "python-can"),
    }
    save_json(json_file, figures=figures.as_dict(), facts=facts)
    ended = "stopped" if is_stopped() else "done"
    console.print(f"{ended}: the request for control is withdrawn, also on the bus, and the jets are shut")
    if was_cut_short:
        raise KeyboardInterrupt
    if figures.commands == 0:
        raise typer.Exit(NO_COMMANDS)


def slowed(config: Config, factor: float) -> Config:
    """The same vehicle at a speed divided by the factor: times grow by it, pressures and flow rates shrink. Raises
    ConfigError if the factor is not a number from 1 to 1000."""
    if not (isfinite(factor) and 1.0 <= factor <= 1000.0):
        raise ConfigError(f"--slow-down {factor:g}: must be a number from 1 to 1000")
    point = config.operating_point
    return replace(config, operating_point=replace(point, speed=point.speed / factor))


def note_of(figures: "Figures") -> str:
    """How it goes, for the progress line."""
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
            f"renew ... --set operating_point.speed={point.speed:g}` makes one for this vehicle",
            style="yellow",
        )


def _replay(config: Config, dataset: Path | None, episode: str | None, begin: float) -> "Pressures":
    from contract.recording.dataset import read
    from contract.shipped import recording
    from firmware_sim.bench.real_time.pressures import Replay

    first = begin / config.flow.control_period
    if not first < 1e9:
        raise ConfigError(f"--from {begin:g}: must be a number of t_c within the episode")
    return Replay(read(recording() if dataset is None else dataset), episode, round(first))


def _live(stack: ExitStack, config: Config, start: Path | None, drive: "Drive | None") -> "Pressures":
    from firmware_sim.bench.real_time.live_wake import LiveWake

    with progress_bar("t_c") as bar:
        tasks: list[Any] = []

        def settling(t: float, total: float) -> None:
            if not tasks:
                tasks.append(bar.add_task("wake settles on this grid", total=total, note=""))
            bar.update(tasks[0], completed=round(t, 1))

        wake = stack.enter_context(LiveWake(config, start, settling, drive))
    flow = config.flow
    warning = wake.speed.check(config.period_ns / 1e6, refinement=flow.refinement, substeps=flow.substeps)
    console.print(
        f"the wake takes {wake.speed.typical_ms:.1f} ms for a control period, at worst {wake.speed.worst_ms:.1f} ms"
    )
    if warning is not None:
        console.print(warning, style="yellow")
    return wake


def _print_figures(figures: "Figures", pressures: str) -> None:
    modes = ", ".join(f"{mode.name} {count}" for mode, count in sorted(figures.modes.items())) or "none"

    def quantiles(times: Any) -> str:
        if figures.commands == 0 and times is figures.ages:
            return "none"
        return " / ".join(f"{times.quantile_ms(share):.2f}" for share in (0.5, 0.99, 1.0)) + " ms"

    rows = (
        ("pressures", pressures),
        ("periods", str(figures.periods)),
        ("of these left out: the vehicle itself was late", str(figures.left_out)),
        ("of these without pressures: the live wake was late", str(figures.unsampled)),
        ("pressure frames that the bus did not take", str(figures.unsent)),
        ("usable commands received", str(figures.commands)),
        ("misses: periods without one, after the first", str(figures.misses)),
        ("commands that were for the period they came in", str(figures.at_once)),
        ("age of the pressures at the command's arrival, p50 / p99 / max", quantiles(figures.ages)),
        ("lateness of the sampling, p50 / p99 / max", quantiles(figures.lateness)),
        ("action, rms / largest", f"{figures.rms_action:.4f} / {figures.largest:.4f} U_inf W"),
        ("modes of the ECU in them", modes),
    )
    print_table("vehicle", "", rows=rows)
