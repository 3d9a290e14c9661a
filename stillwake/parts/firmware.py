"""The whole firmware of an emulated microcontroller, connected to a real CAN bus."""

import time
from pathlib import Path
from typing import Final

from stillwake.console.settings import DIAGNOSIS, REAL_BUS, settings
from stillwake.console.stopping import until_stopped
from stillwake.console.terminal import console
from stillwake.parts.releases import open_release

_USES: Final = ("operating_point", *REAL_BUS, DIAGNOSIS, "ecu")
_SERIAL: Final = "1"
"""Serial number of every emulated microcontroller."""


def run_firmware(
    given: list[str], bundle: Path | None, flash: Path, hardware: str, *, library: Path, root: Path, access: Path
) -> None:
    """Run the firmware until it is stopped. Raises StillwakeError if library, bundle and settings do not belong
    together, the library does not compile, or the bus cannot be opened.

    Args:
        given: the texts of `--set`.
        bundle: bundle of the library; the shipped bundle if None.
        flash: file with the contents of the flash memory; created if it does not exist.
        hardware: name of the hardware.
        library: C library from which the firmware is built.
        root: file of the public root key, which verifies key lists.
        access: file of the ECU's access key.
    """
    from can_bridge.bus.backends.python_can import PythonCanBus
    from can_bridge.secoc.key import read_secret
    from can_bridge.wire.message_sets import message_set
    from contract.release import controller_image, signing
    from ecu.in_c.c_ecu import ecu_sources
    from ecu.in_c.c_image import controller_image as image_of
    from ecu.in_c.c_image import read_packed
    from firmware_sim.mcu.board.board_ecu import BoardEcu
    from firmware_sim.mcu.board.on_a_bus import equipment_header, read_bank, serve
    from firmware_sim.mcu.build import EQUIPMENT

    config = settings("ecu --mcu", given, uses=_USES).config
    release, bank = open_release(bundle), read_bank(flash)
    sources = ecu_sources(library, release, config)
    vehicle = controller_image.read(image_of(sources | read_packed(library), release, config, None)).facts.vehicle
    header = equipment_header(signing.read_public_key(root), read_secret(access), vehicle, hardware, _SERIAL)
    console.print("building the firmware")
    ecu = BoardEcu(sources, own={EQUIPMENT: header}, bank=bank)
    # The bus delivers only the frames of the message set and of diagnosis; the filters of the emulated CAN controller
    # select the ECU's frames from these.
    accept = [spec.frame_id for spec in message_set(config.bus).specs] + list(config.bus.diagnosis.heard)
    with PythonCanBus.open(config.bus, accept=accept) as port, until_stopped() as is_stopped:
        console.print(f"{hardware}: running, flash in {flash}; stop with Ctrl-C")
        serve(ecu, port, flash, clock_ns=time.monotonic_ns, wait=lambda: time.sleep(0.001), is_stopped=is_stopped)
