"""A board with the loader, images for it, and a tester that reaches it through its CAN controller, in virtual time."""

from collections import deque
from dataclasses import replace

from udsoncan.client import Client
from udsoncan.exceptions import TimeoutException

from can_bridge.isotp.endpoint import Endpoint
from can_bridge.tester.asking import Asking
from can_bridge.tester.key_list import bring
from can_bridge.tester.matching import answers
from can_bridge.tester.sequence import Flashed, flash
from can_bridge.uds.services import REQUEST_ID, RESPONSE_ID
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
from tests.can_bridge.tester.direct_connection import DirectConnection
from tests.firmware_sim.ecu_in_c import CONFIG, Exported

NS, TICK_NS = 1_000_000_000, 1_000_000


class Built:
    """Of one release: the firmware's sources, boards, and images by name and security version."""

    def __init__(self, release: Exported) -> None:
        library = ecu_sources(release.folder, release.bundle, CONFIG)
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
        return image_of(self._files, bundle, CONFIG, RELEASE)

    @staticmethod
    def digest(version: int) -> bytes:
        """Of a release by its security version."""
        return bytes([version]) * 32


class BoardLine(DirectConnection):
    """udsoncan's connection by ISO-TP through the board's registers.

    Attributes:
        frames: in both directions.
    """

    def __init__(self, ecu: BoardEcu) -> None:
        super().__init__()
        self.ecu, self.frames = ecu, 0
        self._end = Endpoint(isotp_settings(CONFIG.bus, receive_id=RESPONSE_ID, send_id=REQUEST_ID))
        self._request, self._waiting = b"", deque[bytes]()

    def clock(self) -> float:
        return self.ecu.board.counter.now_ns / NS

    def sleep(self, seconds: float) -> None:
        until_ns = self.ecu.board.counter.now_ns + round(seconds * NS)
        while self.ecu.board.counter.now_ns < until_ns:
            self._tick(until_ns)

    def empty_rxqueue(self) -> None:
        self._waiting.clear()

    def specific_send(self, payload: bytes, timeout: float | None = None) -> None:
        self._request = payload
        self._end.send(payload)

    def specific_wait_frame(self, timeout: float | None = None) -> bytes:
        until_ns = self.ecu.board.counter.now_ns + round((timeout or 0.0) * NS)
        while self.ecu.board.counter.now_ns <= until_ns:
            while self._waiting:
                payload = self._waiting.popleft()
                if answers(self._request, payload):
                    return payload
            self._tick(until_ns + 1)
        raise TimeoutException

    def provision(self, keys: bytes, image: bytes) -> None:
        """A key list and a first release for a fresh board."""
        bring(Asking(Client(self), key=KEY.answer, clock=self.clock, sleep=self.sleep), keys)
        self.flash(image)

    def flash(self, image: bytes) -> Flashed:
        """The tester's whole sequence."""
        return flash(Client(self), image, key=KEY.answer, clock=self.clock, sleep=self.sleep)

    def _tick(self, until_ns: int) -> None:
        now_ns = self.ecu.board.counter.now_ns
        asked = self._end.poll(now_ns)
        sent = self.ecu.advance(min(until_ns, now_ns + TICK_NS), asked)
        heard = [frame for frame in sent if frame.frame_id == RESPONSE_ID]
        for frame in heard:
            self._end.receive(self.ecu.board.counter.now_ns, frame)
        self.frames += len(asked) + len(heard)
        self._waiting.extend(self._end.take())
