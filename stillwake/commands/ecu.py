"""The command `stillwake ecu`: the ECU on a real bus, and the folder of an ECU that can be flashed."""

import sys
import time
from dataclasses import fields
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Final, Literal

import typer
from typer.core import TyperGroup

from contract.config.tree import Config
from contract.config.vehicle import EcuConfig
from contract.errors import ConfigError
from stillwake.console import options as shared
from stillwake.console.outputs import check_apart, check_frames, claim
from stillwake.console.settings import COST_WEIGHTS, DIAGNOSIS, REAL_BUS, settings, with_bus
from stillwake.console.stopping import until_stopped
from stillwake.console.terminal import console, visible
from stillwake.parts.releases import asked_calibration, open_release, signature

if TYPE_CHECKING:
    from ecu.daemon.process import ProcessOptions

_USES: Final = (
    "operating_point",
    "flow.control_period",
    "flow.action_limit",
    *REAL_BUS,
    "bus.key",
    # The setting of the compute time is left out, because in real time a step's duration is not simulated.
    *(f"ecu.{item.name}" for item in fields(EcuConfig) if item.name != "compute_time_ms"),
    COST_WEIGHTS,
)
_VEHICLE: Final = ("operating_point", "flow.control_period", "flow.action_limit", "ecu.delay_steps", "ecu.plan_ahead")
_FIRMWARE: Final = ("operating_point", *REAL_BUS, DIAGNOSIS, "ecu")
_RUN: Final = "run"
_MAKES: Final = {
    "access": "`stillwake keygen --secret` makes a key",
    "root": "`stillwake keygen` makes a key pair",
    "library": "`stillwake export --c` writes a library",
}
"""Hints for error messages: for each option, the command that makes the option's file."""


class _RunsByDefault(TyperGroup):
    """A command group in which `stillwake ecu BUNDLE` means `stillwake ecu run BUNDLE`."""

    default_command = _RUN

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        if not args or args[0] not in self.commands:
            args = [self.default_command, *args]
        return super().parse_args(ctx, args)


ecu = typer.Typer(cls=_RunsByDefault, help="Run the ECU on a real CAN bus; set up an ECU that can be flashed.")

Board = Annotated[
    Path | None,
    typer.Option("--mcu", help="File of an emulated microcontroller's flash; created if missing.", metavar="FILE"),
]
Spin = Annotated[float, typer.Option(help="Time of busy waiting before a deadline, microseconds.", min=0.0, max=5000.0)]


@ecu.command(name=_RUN)
def run(
    bundle: Annotated[Path | None, typer.Argument(help="Release bundle; default: the shipped bundle.")] = None,
    trust: shared.Trust = None,
    library: shared.Library = None,
    slots: shared.Slots = None,
    mcu: Board = None,
    access: shared.Access = None,
    root: shared.Root = None,
    hardware: Annotated[str | None, typer.Option(help="Hardware's name; default: the folder's name, or mcu.")] = None,
    periods: shared.Periods = None,
    log: Annotated[Literal["plain", "json"], typer.Option("--log", help="Format of the log, on stderr.")] = "plain",
    metrics: Annotated[Path | None, typer.Option(help="Write counters for Prometheus here.", metavar="FILE")] = None,
    stage_times: shared.StageTimes = None,
    freshness: shared.Freshness = None,
    priority: shared.Priority = 50,
    spin: Spin = 0.0,
    frames: shared.Frames = None,
    bus: shared.Bus = None,
    given: shared.Settings = [],  # noqa: B006
) -> None:
    """Run the ECU on a real CAN bus: read pressures and send a jet command in each control period, until the command is
    stopped.

    The jets stay shut until the ECU has received a low enable request from the vehicle, and then a high request. In
    three cases the ECU sends commands that shut the jets: the program ends, also by Ctrl-C, SIGTERM or SIGHUP; the bus
    was lost, and the ECU has opened it again; or another ECU sends commands on the bus. Real-time privileges are used
    if the system grants them; otherwise a message reports the missing privileges. With bus.key, --freshness is
    required; only a systemd service with a state directory has a default, which is a file in this directory.

    With --slots the command runs the release in a folder. `stillwake ecu provision` makes the folder, `stillwake flash`
    replaces the release over the same bus, and `stillwake calibrate` changes its goal and limits. With --mcu the
    command runs the whole firmware of --library in the emulator, from its reset vector. At its first run the firmware
    has no release: send a key list and an image (`export --image`) with `stillwake flash`. A control step of the
    emulated firmware takes longer than a control period, so use `stillwake run --ecu mcu` for control.

    stillwake ecu --bus socketcan:can0

    stillwake ecu --slots slots --access access.key --bus socketcan:can0

    stillwake ecu --mcu flash.bin --library ecu_c --root root/release.pub --access access.key --bus socketcan:can0
    """
    from ecu.daemon.process import ProcessOptions
    from ecu.daemon.reporter import as_json, plain
    from ecu.real_time.privileges import Wanted

    options = ProcessOptions(
        wanted=Wanted(priority=priority),
        spin_ns=round(spin * 1e3),
        periods=periods,
        stage_times=stage_times,
        metrics=metrics,
        freshness=freshness,
        frames=frames,
        as_line=as_json if log == "json" else plain,
    )
    check_frames(frames)
    texts = with_bus(bus, given)
    if mcu is not None:
        of_process = {"stage-times": stage_times, "freshness": freshness, "spin": spin or None, "metrics": metrics}
        _refuse("--mcu runs a firmware", trust=trust, slots=slots, periods=periods, frames=frames, **of_process)
        needed = {"library": library, "root": root, "access": access}
        _run_firmware(texts, bundle, mcu, hardware or "mcu", **_needed("--mcu", **needed))
    elif slots is not None:
        _refuse("--slots runs the release in its folder", BUNDLE=bundle, trust=trust, library=library)
        _run_store(texts, slots, root, hardware, options, **_needed("--slots", access=access))
    else:
        _refuse("needs --slots or --mcu", access=access, root=root, hardware=hardware)
        _run_release(texts, bundle, trust, library, options)


@ecu.command()
def provision(
    folder: Annotated[Path, typer.Argument(help="Folder to make: the ECU's memory.")],
    root: Annotated[Path, shared.ROOT],
    keys: Annotated[Path, typer.Option("--keys", help="Keys that sign releases (`bundle keylist`).", metavar="LIST")],
    bundle: Annotated[Path | None, typer.Option(help="Release bundle that runs from the start; default: none.")] = None,
    hardware: Annotated[str, typer.Option(help="Name of the hardware, which a bundle may require.")] = "generic",
    serial: Annotated[str | None, typer.Option(help="Serial number of this ECU; default: random.")] = None,
    given: shared.Settings = [],  # noqa: B006
) -> None:
    """Make the folder of an ECU that can be flashed, with its keys and, on request, its first release.

    Existing files are never overwritten. `stillwake ecu --slots FOLDER` runs the ECU.

    stillwake ecu provision slots --root root/release.pub --keys keys.list --bundle contract/release/shipped
    """
    from secrets import token_hex

    from contract.release.container import image_of, read_files
    from contract.runtime.onnx_session import OnnxController
    from ecu.flashable import ecu_folder
    from ecu.flashable.vehicle_fit import VehicleFit

    config = settings("ecu provision", given, uses=_VEHICLE).config
    made = ecu_folder.provision(
        folder,
        root=root,
        keys=keys.read_bytes(),
        image=None if bundle is None else image_of(read_files(bundle)),
        hardware=hardware,
        serial=token_hex(4) if serial is None else serial,
        fits=VehicleFit(config, OnnxController.of).fits,
    )
    runs = "no release yet: flash a bundle" if bundle is None else f"release {bundle}"
    console.print(f"wrote {folder}: ECU {made.serial} ({made.hardware}), {runs}")


def _run_release(
    given: list[str], bundle: Path | None, trust: str | None, library: Path | None, options: "ProcessOptions"
) -> None:
    from contract.controller.interface import RunnableController
    from contract.runtime.onnx_session import OnnxController
    from ecu.daemon import process
    from ecu.in_c.host_library import open_library

    loaded = settings("ecu", given, uses=_USES)
    _check_files(loaded.config, options)
    release = open_release(bundle, trust)
    calibration = asked_calibration(loaded, release)
    controller: RunnableController = OnnxController.of(release) if library is None else open_library(library, release)
    with until_stopped() as is_stopped:
        counters = process.serve(
            release,
            controller,
            loaded.config,
            options,
            calibration=calibration,
            is_stopped=is_stopped,
            write=_to_stderr,
            signature=signature(release),
        )
    if options.periods is not None and counters.steps < options.periods:
        raise KeyboardInterrupt


def _run_store(
    given: list[str], slots: Path, root: Path | None, hardware: str | None, options: "ProcessOptions", *, access: Path
) -> None:
    from can_bridge.uds.security import AccessKey
    from ecu.daemon.store_service import serve_store
    from ecu.flashable.ecu_folder import read_folder

    uses = (*(name for name in _USES if name != COST_WEIGHTS), DIAGNOSIS)
    config = settings("ecu --slots", given, uses=uses).config
    _check_files(config, options, access)
    folder = read_folder(slots, root=root, hardware=hardware)
    key = AccessKey.read(access)
    with until_stopped() as is_stopped:
        counters = serve_store(
            folder, key, config, options, software=version("stillwake"), is_stopped=is_stopped, write=_to_stderr
        )
    if options.periods is not None and counters.steps < options.periods:
        raise KeyboardInterrupt


def _run_firmware(
    given: list[str], bundle: Path | None, flash: Path, hardware: str, *, library: Path, root: Path, access: Path
) -> None:
    from can_bridge.bus.backends.python_can import PythonCanBus
    from can_bridge.secoc.key import read_secret
    from can_bridge.wire.message_sets import message_set
    from contract.release import controller_image, signing
    from ecu.in_c.c_ecu import ecu_sources
    from ecu.in_c.c_image import controller_image as image_of
    from ecu.in_c.c_image import read_packed
    from firmware_sim.mcu.board.board_ecu import BoardEcu, read_bank, serve
    from firmware_sim.mcu.build import EQUIPMENT, equipment_header

    config = settings("ecu --mcu", given, uses=_FIRMWARE).config
    release, bank = open_release(bundle), read_bank(flash)
    sources = ecu_sources(library, release, config)
    vehicle = controller_image.read(image_of(sources | read_packed(library), release, config, None)).facts.vehicle
    serial = "1"  # of every emulated microcontroller
    header = equipment_header(signing.read_public_key(root), read_secret(access), vehicle, hardware, serial)
    console.print("building the firmware")
    ecu = BoardEcu(sources, own={EQUIPMENT: header}, bank=bank)
    # The bus delivers only the frames of the message set and of diagnosis. The filters of the emulated CAN controller
    # then select the ECU's frames.
    accept = [spec.frame_id for spec in message_set(config.bus).specs] + list(config.bus.diagnosis.heard)
    with PythonCanBus.open(config.bus, accept=accept) as port, until_stopped() as is_stopped:
        console.print(f"{hardware}: running, flash in {flash}; stop with Ctrl-C")
        serve(ecu, port, flash, clock_ns=time.monotonic_ns, wait=lambda: time.sleep(0.001), is_stopped=is_stopped)


def _check_files(config: Config, options: "ProcessOptions", *read: Path) -> None:
    """Check that the process's files and its keys are different files, and lock the files that it writes. Two nodes
    with the same freshness file would set back each other's number of power cycles."""
    if options.freshness is not None and not config.bus.key:
        raise ConfigError("--freshness: needs a key, but bus.key is empty")
    written = (options.metrics, options.stage_times, options.freshness)
    check_apart(*written, options.frames, *read, Path(config.bus.key) if config.bus.key else None)
    for path in filter(None, written):
        claim(path)


def _refuse(why: str, **given: Any) -> None:
    for name, value in given.items():
        if value is not None:
            raise ConfigError(f"{name if name.isupper() else f'--{name}'}: {why}; leave it out")


def _needed(what: str, **given: Path | None) -> dict[str, Path]:
    """Return the paths that the option `what` needs; raises ConfigError for the first missing path."""
    found = {}
    for name, value in given.items():
        if value is None:
            raise ConfigError(f"{what}: needs --{name}; {_MAKES[name]}")
        found[name] = value
    return found


def _to_stderr(line: str) -> None:
    sys.stderr.write(f"{visible(line)}\n")
    sys.stderr.flush()
