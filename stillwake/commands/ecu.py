"""`stillwake ecu`: the ECU on a real bus, and what belongs to one that can be flashed."""

import sys
from dataclasses import fields
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Final, Literal

import typer
from typer.core import TyperGroup

from contract.config.tree import Config
from contract.config.vehicle import EcuConfig
from contract.errors import ConfigError
from stillwake.commands.ecu_board import board
from stillwake.commands.run import asked_calibration
from stillwake.console.bus_option import BusName, with_bus
from stillwake.console.settings import DIAGNOSIS, REAL_BUS, TESTERS_BUS, WEIGHTS, settings
from stillwake.console.stopping import until_stopped
from stillwake.console.terminal import ConfigFile, Overrides, console, print_table, visible
from stillwake.parts.conversation import asking
from stillwake.parts.releases import Library, Trust, open_release, signature

if TYPE_CHECKING:
    from can_bridge.flashing.report import Report
    from firmware_sim.ecu.daemon.service import Options

_USES: Final = (
    "operating_point",
    "flow.control_period",
    "flow.action_limit",
    *REAL_BUS,
    "bus.key",
    # In real time the step takes what it takes.
    *(f"ecu.{item.name}" for item in fields(EcuConfig) if item.name != "compute_time_ms"),
    WEIGHTS,
)
_VEHICLE: Final = ("operating_point", "flow.control_period", "flow.action_limit", "ecu.delay_steps", "ecu.plan_ahead")
_RUN: Final = "run"
_FACTS: Final = {
    "serial_number": "serial number",
    "hardware": "hardware",
    "software_version": "stillwake",
    "dbc_sha256": "DBC",
    "root_key": "root key",
    "period_ns": "control period",
    "capacity": "greatest image, bytes",
}
"""What `info` shows of an ECU, by its name for machines."""


class _RunsByDefault(TyperGroup):
    """`stillwake ecu BUNDLE` is `stillwake ecu run BUNDLE`."""

    default_command = _RUN

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        if not args or args[0] not in self.commands:
            args = [self.default_command, *args]
        return super().parse_args(ctx, args)


ecu = typer.Typer(cls=_RunsByDefault, help="Run the ECU on a real CAN bus; provision one that can be flashed.")
ecu.command(name="board")(board)

Slots = Annotated[
    Path | None,
    typer.Option(help="Folder of an ECU that can be flashed, as `ecu provision` makes it.", metavar="FOLDER"),
]
RootKey = Annotated[
    Path | None,
    typer.Option(help="Public root key (PEM) that signs key lists; default: the folder's own copy.", metavar="PUB"),
]


@ecu.command(name=_RUN)
def run(
    bundle: Annotated[Path | None, typer.Argument(help="Release bundle; default: the shipped one.")] = None,
    trust: Trust = None,
    slots: Slots = None,
    access: Annotated[
        Path | None,
        typer.Option(help="With --slots: access key of the tester, as `can keygen` writes it.", metavar="KEYFILE"),
    ] = None,
    root: RootKey = None,
    hardware: Annotated[
        str | None, typer.Option(help="With --slots: name of the hardware, in place of the folder's.")
    ] = None,
    library: Library = None,
    periods: Annotated[
        int | None, typer.Option(help="End after so many control steps; default: run until stopped.", min=1)
    ] = None,
    log: Annotated[Literal["plain", "json"], typer.Option(help="Lines of the log, on stderr.")] = "plain",
    metrics: Annotated[
        Path | None, typer.Option(help="Write counters for Prometheus here, once a second.", metavar="FILE")
    ] = None,
    stage_times: Annotated[
        Path | None, typer.Option(help="Write when each stage of each period happened here, at the end (.npz).")
    ] = None,
    freshness: Annotated[
        Path | None,
        typer.Option(
            help="With bus.key: what must outlive a restart; default: in systemd's state directory.", metavar="FILE"
        ),
    ] = None,
    priority: Annotated[int, typer.Option(help="Of SCHED_FIFO, 1 to 99; 0: an ordinary process.", min=0, max=99)] = 50,
    processor: Annotated[int | None, typer.Option(help="Run on this processor alone.", min=0)] = None,
    spin: Annotated[
        float, typer.Option(help="Stay awake for so many microseconds before each deadline.", min=0.0, max=5000.0)
    ] = 0.0,
    bus: BusName = None,
    config_file: ConfigFile = None,
    overrides: Overrides = [],  # noqa: B006
) -> None:
    """Run the ECU on a real CAN bus: pressures in, jet commands out, once a control period, until stopped.

    The jets stay shut until the vehicle raises its enable request while the ECU is there. They are shut on the bus
    when the command ends, also by Ctrl-C or SIGTERM; when the bus is lost, which is opened again; and when another ECU
    commands on it. Real-time privileges are used where they are granted, and told where they are not.

    With --slots it runs the release in a folder, which `stillwake flash` replaces over the same bus and `stillwake
    calibrate` tunes; `stillwake ecu provision` makes the folder, `stillwake ecu info` shows what runs.

    stillwake ecu --bus socketcan:can0

    stillwake ecu --slots slots --access access.key --bus socketcan:can0
    """
    from contract.controller.interface import RunnableController
    from contract.runtime.onnx_session import OnnxController
    from firmware_sim.ecu.daemon import service
    from firmware_sim.ecu.daemon.events import as_json, plain
    from firmware_sim.ecu.real_time.privileges import Wanted
    from firmware_sim.in_c.library_controller import open_library

    uses = _USES if slots is None else (*(name for name in _USES if name != WEIGHTS), DIAGNOSIS)
    loaded = settings("ecu", config_file, with_bus(bus, overrides), uses=uses)
    if freshness is not None and not loaded.config.bus.key:
        raise ConfigError("--freshness: goes with bus.key, which names no key")
    options = service.Options(
        wanted=Wanted(priority=priority, processor=processor),
        spin_ns=round(spin * 1e3),
        periods=periods,
        stage_times=stage_times,
        metrics=metrics,
        freshness=freshness,
        as_line=as_json if log == "json" else plain,
    )
    if slots is not None:
        _refuse("--slots runs the release in its folder", BUNDLE=bundle, trust=trust, library=library)
        if access is None:
            raise ConfigError("--slots: needs --access KEYFILE; `stillwake can keygen` makes a key")
        _run_store(slots, access, root, hardware, loaded.config, options)
        return
    _refuse("goes with --slots", access=access, root=root, hardware=hardware)
    release = open_release(bundle, trust)
    calibration = asked_calibration(loaded, release)
    controller: RunnableController = OnnxController.of(release) if library is None else open_library(library, release)
    with until_stopped() as is_stopped:
        counters = service.serve(
            release,
            controller,
            loaded.config,
            options,
            calibration=calibration,
            is_stopped=is_stopped,
            write=_to_stderr,
            signature=signature(release),
        )
    if periods is not None and counters.steps < periods:
        raise KeyboardInterrupt


@ecu.command()
def provision(
    folder: Annotated[Path, typer.Argument(help="Folder to make: the ECU's memory.")],
    root: Annotated[Path, typer.Option(help="Public root key (PEM): who signs key lists.", metavar="PUB")],
    keys: Annotated[
        Path, typer.Option(help="Key list, as `bundle keylist` makes it: who signs releases.", metavar="LIST")
    ],
    bundle: Annotated[
        Path | None, typer.Option(help="Release that runs from the start; default: none, flash the first one.")
    ] = None,
    hardware: Annotated[str, typer.Option(help="Name of the hardware, which a bundle may demand.")] = "generic",
    serial: Annotated[str | None, typer.Option(help="Number of this ECU; default: a random one.")] = None,
    config_file: ConfigFile = None,
    overrides: Overrides = [],  # noqa: B006
) -> None:
    """Make the folder of an ECU that can be flashed: its keys, and perhaps its first release.

    What is there already is never overwritten. `stillwake ecu --slots FOLDER` runs it.

    stillwake ecu provision slots --root root/release.pub --keys keys.list --bundle firmware_sim/data/bundle
    """
    from secrets import token_hex

    from contract.release.container import read_files
    from contract.release.image import image_of
    from contract.runtime.onnx_session import OnnxController
    from firmware_sim.ecu.flashable import ecu_folder
    from firmware_sim.ecu.flashable.vehicle_fit import VehicleFit

    config = settings("ecu provision", config_file, overrides, uses=_VEHICLE).config
    made = ecu_folder.provision(
        folder,
        root=root,
        keys=keys.read_bytes(),
        image=None if bundle is None else image_of(read_files(bundle)),
        hardware=hardware,
        serial=token_hex(4) if serial is None else serial,
        fits=VehicleFit(config, OnnxController.of).fits,
    )
    runs = "no release yet: flash one" if bundle is None else f"release {bundle}"
    console.print(f"wrote {folder}: ECU {made.serial} ({made.hardware}), {runs}")


@ecu.command()
def info(
    bus: BusName = None,
    slots: Slots = None,
    root: RootKey = None,
    as_json: Annotated[bool, typer.Option("--json", help="For machines.")] = False,
    config_file: ConfigFile = None,
    overrides: Overrides = [],  # noqa: B006
) -> None:
    """Show what an ECU reports of itself: over its bus, or from its folder.

    stillwake ecu info --bus socketcan:can0
    """
    config = settings("ecu info", config_file, with_bus(bus, overrides), uses=TESTERS_BUS).config
    found, report = _asked(config) if slots is None else _from_folder(slots, root)
    if as_json:
        from can_bridge.flashing.report import tree

        console.print_json(data={**found, "store": tree(report)})
        return
    if "period_ns" in found:
        found["period_ns"] = f"{int(found['period_ns']) / 1e6:g} ms"
    rows = dict(_rows(report))
    if slots is not None:
        rows["runs"] = "the folder does not hold it; --bus in place of --slots asks the ECU"
    shown = {**{_FACTS[name]: str(value) for name, value in found.items()}, **rows}
    print_table(rows=((name, visible(value)) for name, value in shown.items()), show_header=False)


def _run_store(
    slots: Path, access: Path, root: Path | None, hardware: str | None, config: Config, options: "Options"
) -> None:
    from can_bridge.uds.access_key import AccessKey
    from firmware_sim.ecu.daemon.store_service import serve_store
    from firmware_sim.ecu.flashable.ecu_folder import read_folder

    folder = read_folder(slots, root=root, hardware=hardware)
    key = AccessKey.read(access)
    with until_stopped() as is_stopped:
        counters = serve_store(
            folder,
            key,
            config,
            options,
            software=version("stillwake"),
            is_stopped=is_stopped,
            write=_to_stderr,
        )
    if options.periods is not None and counters.steps < options.periods:
        raise KeyboardInterrupt


def _refuse(why: str, **given: Any) -> None:
    for name, value in given.items():
        if value is not None:
            raise ConfigError(f"{name if name.isupper() else f'--{name}'}: {why}; leave it out")


def _asked(config: Config) -> "tuple[dict[str, str | int], Report]":
    """What the ECU on a bus reports."""
    from can_bridge.tester.facts import read_facts

    with asking(config.bus) as ecu:
        facts = read_facts(ecu)
    names = ("serial_number", "hardware", "software_version", "dbc_sha256", "period_ns", "capacity")
    return {name: getattr(facts, name) for name in names}, facts.store


def _from_folder(slots: Path, root: Path | None) -> "tuple[dict[str, str | int], Report]":
    """What stands in an ECU's folder; nothing is booted and nothing written."""
    from can_bridge.flashing.report import report_of
    from can_bridge.flashing.store import Store
    from can_bridge.flashing.verdicts import Verdict
    from firmware_sim.ecu.flashable.ecu_folder import read_folder

    folder = read_folder(slots, root=root)
    store = Store(
        folder.backing(), root=folder.root, hardware=folder.hardware, fits=lambda bundle: Verdict.WRONG_VEHICLE
    )
    found: dict[str, str | int] = {
        "serial_number": folder.serial,
        "hardware": folder.hardware,
        "root_key": folder.root.fingerprint,
        "capacity": store.capacity,
    }
    return found, report_of(store)


def _rows(report: "Report") -> list[tuple[str, str]]:
    """Of a store, for people."""
    from can_bridge.flashing.backing import Slot

    rows = []
    for slot, standing in zip(Slot, report.slots, strict=True):
        words = [standing.phase.name.lower()]
        if standing.name:
            words.append(f"{standing.name} {standing.digest[:12]}, security version {standing.security_version}")
        if standing.received < standing.length:
            words.append(f"{standing.received} of {standing.length} bytes")
        if standing.boots_left:
            words.append(f"{standing.boots_left} boots left")
        if standing.verdict:
            words.append(standing.verdict.in_words)
        rows.append((f"slot {slot.name}", ", ".join(words)))
    names = {"runs": report.running, "boots next": report.next_boot}
    rows += [(name, "none" if slot is None else f"slot {slot.name}") for name, slot in names.items()]
    if report.reason is not None:
        rows.append(("at its last boot", report.reason.in_words))
    rows.append(("least security version", str(report.least_security_version)))
    rows.append(("key list", "none" if report.key_list_version is None else f"version {report.key_list_version}"))
    attempts = ", ".join(f"{level.name.lower()} {count}" for level, count in report.failed_attempts.items())
    rows.append(("wrong keys in a row", attempts))
    return rows


def _to_stderr(line: str) -> None:
    sys.stderr.write(f"{visible(line)}\n")
    sys.stderr.flush()
