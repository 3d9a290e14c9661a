"""The command `stillwake latency`, which runs ECU and vehicle as two processes on a bus of this machine, and measures
how long each stage of the control loop takes."""

import os
import shlex
import sys
from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Final

import typer
from rich.table import Column

from contract.atomic import replacing
from contract.config.listing import as_toml, sections
from contract.config.loading import Loaded
from contract.errors import ConfigError, LibraryError
from contract.release.checks import Bundle
from stillwake.console import options as shared
from stillwake.console.outputs import check_json, check_output, save_json
from stillwake.console.progress import progress
from stillwake.console.settings import REAL_BUS, settings
from stillwake.console.terminal import console, print_table
from stillwake.parts.c_release import library_folder
from stillwake.parts.releases import locate, open_release

if TYPE_CHECKING:
    from firmware_sim.latency.measured import KeptLimit, MeasuredRun

LEAD_IN_S: Final = 2.0
"""Time in s from the start to the request for control. By then the ECU's deadlines follow the vehicle's sampling."""
USES: Final = ("operating_point", "flow.control_period", "flow.action_limit", *REAL_BUS, "ecu", "vehicle")

Periods = Annotated[int, typer.Option(help="Number of control periods with a plan to measure.", min=100, max=150_000)]
Budget = Annotated[Path | None, typer.Option(help="Latency limits; exit status 3 if exceeded.", metavar="FILE")]


def latency(
    output: Annotated[Path, typer.Argument(help="Report folder to write.")],
    bundle: shared.Bundle = None,
    library: shared.Library = None,
    both: Annotated[bool, typer.Option("--both", help="Measure ONNX Runtime, then the C library; see above.")] = False,
    periods: Periods = 3000,
    budget: Budget = None,
    overwrite: shared.Overwrite = False,
    json_file: shared.JsonFile = None,
    given: shared.Settings = [],  # noqa: B006
) -> None:
    """Measure the latency of the control loop in real time, from the sampling instant to the command, and the latency
    of an idle loop for comparison.

    `stillwake ecu` and `stillwake vehicle` run as two processes on a bus of this machine. The vehicle replays recorded
    pressures. A third process with the same deadlines and privileges is idle, and shows the delays of the machine
    itself. Every delay is measured from the instant that the schedule prescribes.

    Without --set bus.interface the bus is udp_multicast, with a multicast group of its own. With --both and no
    --library the C library is made from the shipped model; for another bundle, --library is required.

    Exit status 3: the latency budget is exceeded, or the ECU did not stay in control.
    """
    from firmware_sim.latency.measured import PAGE, read_budget, verdicts, write_report

    limits = None if budget is None else read_budget(budget)
    check_output(output, overwrite=overwrite, folder=True, mark=PAGE)
    check_json(json_file)
    loaded = in_real_time(settings("latency", given, uses=USES))
    release = open_release(bundle)
    with ExitStack() as stack, replacing(output) as folder:
        folder.mkdir()
        libraries = _libraries(bundle, library, both=both, stack=stack)
        runs = measured(release, locate(bundle, None)[0], libraries, loaded, folder, periods)
        judged = [[] if limits is None else verdicts(limits, run.counts, run.latencies) for run in runs]
        write_report(folder, runs, judged)
    for run, of_run in zip(runs, judged, strict=True):
        _print(run, of_run)
    facts = {
        "bundle": release.digest,
        "command": shlex.join(("stillwake", *sys.argv[1:])),
        "interface": loaded.config.bus.interface,
        "frames": loaded.config.bus.frames,
    }
    packages = ("stillwake", "numpy", "onnxruntime", "python-can")
    save_json(json_file, figures=figures(runs), facts=facts, packages=packages)
    console.print(f"wrote {output / PAGE}")
    uncontrolled = [run.name for run in runs if run.left_control]
    if uncontrolled:
        console.print(f"the ECU left control: {', '.join(uncontrolled)}", style="bold red")
    broken = [verdict for of_run in judged for verdict in of_run if not verdict.is_kept]
    if broken:
        console.print(f"over budget: {', '.join(verdict.name for verdict in broken)}", style="bold red")
    if broken or uncontrolled:
        raise typer.Exit(3)


def in_real_time(loaded: Loaded) -> Loaded:
    """Return the settings with a bus in real time: the bus that the user named, otherwise `udp_multicast`. Raises
    ConfigError if the named bus works only in virtual time or only within one process."""
    bus = loaded.config.bus
    named = {"bus.interface", "bus.channel"} & loaded.given
    if "bus.interface" not in loaded.given:
        bus = replace(bus, interface="udp_multicast")
    if (kind := bus.interface) in ("simulated", "virtual"):
        raise ConfigError(f"bus.interface = {kind!r}: two processes need a bus between them, such as udp_multicast")
    if kind == "udp_multicast" and "bus.channel" not in loaded.given:
        # Routers do not forward these addresses (RFC 2365). The address depends on the process number, so that
        # simultaneous measurements do not disturb each other.
        high, low = divmod(os.getpid() % 65536, 256)
        bus = replace(bus, channel=f"239.255.{high}.{low}")
    changed = loaded.in_overrides | {"bus.interface", "bus.channel"} - named
    return replace(loaded, config=replace(loaded.config, bus=bus), in_overrides=changed)


def measured(
    release: Bundle, bundle: Path, libraries: Mapping[str, Path | None], loaded: Loaded, folder: Path, periods: int
) -> "list[MeasuredRun]":
    """Measure the controllers one after another: "onnx", which ONNX Runtime computes, or "c", which a C library
    computes. Write each controller's tables into a folder with its name."""
    from can_bridge.e2e.profiles import profile_of
    from can_bridge.wire.message_sets import message_set
    from firmware_sim.latency.measured import MeasuredRun
    from firmware_sim.latency.running import longest_run, recorded

    config = loaded.config
    chosen, own = folder / "settings.toml", []
    for section in sections(config):
        # Only these settings are passed on; all others have the same defaults in both processes.
        own.append(replace(section, settings=tuple(one for one in section.settings if one.name in loaded.given)))
    chosen.write_text(as_toml(own), encoding="utf-8")
    lead_in = LEAD_IN_S / config.operating_point.convective_time
    before = round(LEAD_IN_S * 1e9 / config.period_ns) + release.manifest.window
    # Further periods are run, but not counted: before the first plan, and after the last counted period.
    total = periods + before + 25
    longest = longest_run(total, config.period_ns)
    # The benefit check is off, because the vehicle's pressures are recorded and do not respond to the jets.
    unjudged = ["--set", str(chosen), "--set", "ecu.benefit_check.enabled=false"]
    replay = ["--periods", str(total), "--lead-in", str(lead_in), "--set", str(chosen)]
    counters, runs = profile_of(message_set(config.bus).pressure.spec).counter_period, []
    path = str(bundle.absolute())
    with progress("periods") as report:
        for name, library in libraries.items():
            (folder / name).mkdir()
            computer = "ONNX Runtime" if library is None else "C library"
            about = f"{release.manifest.name} {release.digest[:12]}, {computer}"
            of_c = [] if library is None else ["--library", str(library.absolute())]
            run = recorded(
                folder / name,
                ecu=[*_STILLWAKE, "ecu", path, *of_c, "--periods", str(longest), *unjudged],
                vehicle=[*_STILLWAKE, "vehicle", "--bundle", path, *replay],
                periods=total,
                period_ns=config.period_ns,
                progress=lambda done, name=name, about=about: report(name, done, total, about),  # type: ignore[misc]
            )
            periods_of = {"period_ns": config.period_ns, "counter_period": counters}
            runs.append(MeasuredRun.of(run, name=name, about=about, **periods_of))
    return runs


def figures(runs: "Sequence[MeasuredRun]") -> dict[str, Any]:
    """Return the figures of a results file: counts over all runs, and each run's figures by its controller's name."""
    from firmware_sim.latency.measured import COUNTS

    own = {run.name: run.figures() for run in runs}
    totals = {name: sum(run[name] for run in own.values()) for name in ("periods", *COUNTS)}
    return {**totals, **own}


_STILLWAKE: Final = (sys.executable, "-m", "stillwake")


def _libraries(bundle: Path | None, library: Path | None, *, both: bool, stack: ExitStack) -> Mapping[str, Path | None]:
    """Return the C library of each controller to time, None for ONNX Runtime. A C library that is made here is deleted
    when `stack` is closed. Raises LibraryError if both controllers are requested for a user's bundle without the
    bundle's C library."""
    if library is None:
        if not both:
            return {"onnx": None}
        if bundle is not None:
            raise LibraryError("--both: name the bundle's C library with --library (`stillwake export --c`)")
        console.print("making the C library of the shipped model, as `stillwake export --c` does")
        library = stack.enter_context(library_folder(None))
    return {"onnx": None, "c": library} if both else {"c": library}


def _print(run: "MeasuredRun", verdicts: "Sequence[KeptLimit]") -> None:
    from firmware_sim.latency.measured import BUDGET_HEAD, HEAD, budget_rows, notes, stage_rows

    console.print(f"{run.name}: {run.verdict}", style="yellow" if run.is_too_noisy else "")
    for note in notes(run):
        console.print(note)
    heads = (Column(name, justify="right" if index else "left") for index, name in enumerate(HEAD))
    print_table(*heads, rows=stage_rows(run), title=f"{run.name}: latency, ms")
    if verdicts:
        print_table(*BUDGET_HEAD, rows=budget_rows(verdicts), title=f"{run.name}: budget")
