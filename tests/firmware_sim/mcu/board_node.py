"""A board with the loader, images for it, and a tester that reaches it through its CAN controller, in virtual time."""

from dataclasses import replace
from typing import Any

from udsoncan.client import Client

from can_bridge.isotp.endpoint import Endpoint
from can_bridge.tester.asking import Asking
from can_bridge.tester.key_list import bring
from can_bridge.tester.sequence import Flashed
from contract.config.tree import Config
from contract.config.vehicle import BusConfig
from contract.release import controller_image, signing
from firmware_sim.ecu.flashable.diagnostic_link import isotp_settings
from firmware_sim.in_c.c_ecu import ecu_sources
from firmware_sim.in_c.c_image import controller_image as image_of
from firmware_sim.in_c.c_image import read_packed
from firmware_sim.mcu.board.board_ecu import BoardEcu
from firmware_sim.mcu.board.equipment import equipment_header
from firmware_sim.mcu.board.flash_controller import FlashBank
from firmware_sim.mcu.build import EQUIPMENT
from firmware_sim.mcu.elf import Firmware
from tests.can_bridge.flashing.releases import RELEASE, ROOT
from tests.can_bridge.flashing.store_ecu import KEY, SECRET
from tests.can_bridge.tester.line import Line, flash_over
from tests.firmware_sim.ecu_in_c import CONFIG, Exported

TICK_NS = 1_000_000


class Built:
    """Of one release: the firmware's sources, boards, and images by name and security version."""

    def __init__(self, release: Exported, config: Config = CONFIG) -> None:
        self._config = config
        library = ecu_sources(release.folder, release.bundle, config)
        self._bundle, self._files = release.bundle, library | read_packed(release.folder)
        vehicle = controller_image.read(self.image("one")).facts.vehicle
        made = equipment_header(signing.public_key(ROOT), SECRET, vehicle, "bench", "0815")
        self.sources, self.own = library, {EQUIPMENT: made}

    def ecu(self, bank: FlashBank | None = None, firmware: Firmware | None = None) -> BoardEcu:
        """A board just powered on."""
        return BoardEcu(self.sources, own=self.own, bank=bank, firmware=firmware)

    def image(self, name: str, version: int = 1) -> bytes:
        """With a digest of its own."""
        manifest = replace(self._bundle.manifest, name=name, security_version=version)
        bundle = replace(self._bundle, manifest=manifest, digest=self.digest(version).hex())
        return image_of(self._files, bundle, self._config, RELEASE)

    @staticmethod
    def digest(version: int) -> bytes:
        """Of a release by its security version."""
        return bytes([version]) * 32


class BoardLine(Line):
    """A tester's connection by ISO-TP through the board's registers; its time is the board's."""

    def __init__(self, board: BoardEcu, bus: BusConfig = CONFIG.bus) -> None:
        super().__init__(self)
        self.server: Any = self
        self.is_dead = self.is_reset = False
        self._board, self.time.now_ns = board, board.board.counter.now_ns
        self._response = bus.diagnosis.response
        self._end = Endpoint(isotp_settings(bus, is_tester=True))

    def power_on(self) -> None:
        """Nothing to be done: a reset is the firmware's own."""

    def request(self, _now_ns: int, payload: bytes) -> list[bytes]:
        """Begin to send it."""
        self._end.send(payload)
        return []

    def tick(self, until_ns: int) -> list[bytes]:
        """What has come until then, a millisecond at a time."""
        while (now_ns := self._board.board.counter.now_ns) < until_ns:
            for frame in self._board.advance(min(until_ns, now_ns + TICK_NS), self._end.poll(now_ns)):
                if frame.identifier == self._response:
                    self._end.receive(self._board.board.counter.now_ns, frame)
        return self._end.take()

    def provision(self, keys: bytes, image: bytes) -> None:
        """A key list and a first release for a fresh board."""
        bring(Asking(Client(self), key=KEY.answer, clock=self.time.clock, sleep=self.time.sleep), keys)
        self.flash(image)

    def flash(self, image: bytes) -> Flashed:
        """The tester's whole sequence."""
        return flash_over(self, image)
