"""`stillwake ecu board`: the whole firmware of an emulated board on a real CAN bus."""

import time
from pathlib import Path
from typing import Annotated, Final

import typer

from stillwake.console.bus_option import BusName, with_bus
from stillwake.console.settings import DIAGNOSIS, REAL_BUS, settings
from stillwake.console.stopping import until_stopped
from stillwake.console.terminal import ConfigFile, Overrides, console
from stillwake.parts.releases import open_release

USES: Final = ("operating_point", *REAL_BUS, DIAGNOSIS, "ecu")


def board(
    flash: Annotated[Path, typer.Argument(help="File with the board's flash; made if it is not there: a fresh board.")],
    library: Annotated[Path, typer.Option(help="C library that the firmware is built of (`export --c`).")],
    root: Annotated[Path, typer.Option(help="Public root key (PEM) that signs key lists.", metavar="PUB")],
    access: Annotated[Path, typer.Option(help="The board's access key (`can keygen`).", metavar="KEYFILE")],
    bundle: Annotated[Path | None, typer.Option(help="The library's release bundle; default: the shipped one.")] = None,
    hardware: Annotated[str, typer.Option(help="Name of the hardware.")] = "board",
    serial: Annotated[str, typer.Option(help="Serial number of the board.")] = "1",
    bus: BusName = None,
    config_file: ConfigFile = None,
    overrides: Overrides = [],  # noqa: B006
) -> None:
    """Run a board's whole firmware in the emulator, from its reset vector, on a real CAN bus, until stopped.

    A fresh board has no release: it keeps the jets shut, and takes a key list by `stillwake flash-keys` and an image
    (`export --image`) by `stillwake flash`. What its flash holds is kept in the file. The emulation of a control step
    takes longer than a period: this is for diagnosis and flashing. `stillwake run --ecu cortex-m7` drives.

    stillwake ecu board flash.bin --library ecu_c --root root/release.pub --access access.key \\
        --bus udp_multicast:239.74.163.2
    """
    from can_bridge.bus.backends.python_can import PythonCanBus
    from can_bridge.secoc.key import read_secret
    from can_bridge.wire.message_sets import message_set
    from contract.release import controller_image, signing
    from firmware_sim.in_c.c_ecu import ecu_sources
    from firmware_sim.in_c.c_image import controller_image as image_of
    from firmware_sim.in_c.c_image import read_packed
    from firmware_sim.mcu.board.board_ecu import BoardEcu
    from firmware_sim.mcu.board.equipment import equipment_header
    from firmware_sim.mcu.board.on_a_bus import read_bank, serve
    from firmware_sim.mcu.build import EQUIPMENT

    config = settings("ecu", config_file, with_bus(bus, overrides), uses=USES).config
    release, bank = open_release(bundle, None), read_bank(flash)
    sources = ecu_sources(library, release, config)
    vehicle = controller_image.read(image_of(sources | read_packed(library), release, config, None)).facts.vehicle
    header = equipment_header(signing.read_public_key(root), read_secret(access), vehicle, hardware, serial)
    console.print("building the firmware")
    ecu = BoardEcu(sources, own={EQUIPMENT: header}, bank=bank)
    # The controller's own filters let fewer through.
    accept = [spec.frame_id for spec in message_set(config.bus).specs] + list(config.bus.diagnosis.heard)
    with PythonCanBus.open(config.bus, accept=accept) as port, until_stopped() as is_stopped:
        console.print(f"board {serial}: running, flash in {flash}; stop with Ctrl-C")
        serve(ecu, port, flash, clock_ns=time.monotonic_ns, wait=lambda: time.sleep(0.001), is_stopped=is_stopped)
