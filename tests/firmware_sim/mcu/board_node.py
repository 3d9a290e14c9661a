"""A board with the loader, images for it, and a tester that reaches it through its CAN controller, in virtual time."""

from collections import Counter
from dataclasses import replace
from typing import Any

from can_bridge.flashing.state import Level
from can_bridge.isotp.endpoint import Endpoint
from can_bridge.tester.sequence import End, Flashed, Flashing
from can_bridge.tester.transfer import bring
from can_bridge.wire.frame import Frame
from can_bridge.wire.message_sets import message_set
from contract.config.tree import Config
from contract.config.vehicle import BusConfig
from contract.release import controller_image, signing
from ecu.flashable.links import isotp_settings
from ecu.in_c.c_ecu import ecu_sources
from ecu.in_c.c_image import controller_image as image_of
from ecu.in_c.c_image import read_packed
from firmware_sim.mcu.board.board_ecu import BoardEcu
from firmware_sim.mcu.board.flash_controller import STM32H743, FlashBank, FlashTimes
from firmware_sim.mcu.build import EQUIPMENT, equipment_header
from tests.can_bridge.flashing.releases import RELEASE, ROOT
from tests.can_bridge.flashing.store_ecu import KEY, SECRET
from tests.can_bridge.tester.line import Line
from tests.ecu.in_c.exported import CONFIG, Exported, Feed

TICK_NS = 1_000_000
LOOK_NS = 250_000  # between two looks at a bus whose tester asks as fast as it can
QUICK = FlashTimes(erase_ns=20_000_000, word_ns=10_000)  # for tests in which time has no part
READ = [bytes.fromhex(text) for text in ("22FD01", "22" + 5 * "FD11", "22F18C", "1902FF", "22" + 16 * "F186", "190A")]
PATIENCE_NS = 60_000_000


class Built:
    """Of one release: the firmware's sources, boards, and images by name and security version."""

    def __init__(self, release: Exported, config: Config = CONFIG) -> None:
        self.config = config
        library = ecu_sources(release.folder, release.bundle, config)
        self._bundle, self._files = release.bundle, library | read_packed(release.folder)
        vehicle = controller_image.read(self.image("one")).facts.vehicle
        made = equipment_header(signing.public_key(ROOT), SECRET, vehicle, "bench", "0815")
        self.sources, self.own = library, {EQUIPMENT: made}

    def ecu(self, bank=None, firmware=None, times=STM32H743) -> BoardEcu:
        return BoardEcu(self.sources, own=self.own, bank=bank, firmware=firmware, times=times)

    def image(self, name: str, version: int = 1) -> bytes:
        manifest = replace(self._bundle.manifest, name=name, security_version=version)
        bundle = replace(self._bundle, manifest=manifest, digest=self.digest(version).hex())
        return image_of(self._files, bundle, self.config, RELEASE)

    @staticmethod
    def digest(version: int) -> bytes:
        return bytes([version]) * 32


def on(built: Built, made: BoardEcu, packed: bytes, times: FlashTimes = QUICK) -> BoardEcu:
    return built.ecu(FlashBank.unpack(packed), made.firmware, times)


class Traffic:
    """A board on a bus with a vehicle, that sends pressures and asks for control, and a tester. Frames that the board
    has sent have the times of their ends; `look_ns` passes between two looks at the bus."""

    def __init__(self, board: BoardEcu, config: Config = CONFIG) -> None:
        self.board, self.vehicle, self.sent = board, Feed(config), list[Frame]()
        self._end = Endpoint(isotp_settings(config.bus, is_tester=True))
        self._due_ns, self.look_ns = self.now_ns, LOOK_NS

    @property
    def now_ns(self) -> int:
        return self.board.board.counter.now_ns

    def send(self, request: bytes) -> None:
        self._end.send(request)

    def look(self) -> list[bytes]:
        frames = self._end.poll(self.now_ns)
        if self.now_ns >= self._due_ns:
            self._due_ns += CONFIG.period_ns
            frames += [frame for _, some in self.vehicle.periods(1) for frame in some]
        now = [replace(frame, timestamp_ns=self.now_ns) for frame in frames]
        for frame in self.board.advance(self.now_ns + self.look_ns, now):
            self.sent.append(frame)
            self._end.receive(self.now_ns, frame)
        return self._end.take()

    def run(self, seconds: float) -> None:
        until_ns = self.now_ns + round(seconds * 1e9)
        while self.now_ns < until_ns:
            self.look()

    def read(self, periods: int) -> Counter[tuple[bytes, int]]:
        """So many periods, in which the tester asks again as soon as it may: answers by request and length."""
        began_ns, until_ns, asked, answers = self.now_ns, 0, 0, Counter[tuple[bytes, int]]()
        while self.now_ns < began_ns + periods * CONFIG.period_ns:
            if self.now_ns >= until_ns:
                self.send(READ[asked % len(READ)])
                asked, until_ns = asked + 1, self.now_ns + PATIENCE_NS
            for answer in self.look():
                answers[READ[(asked - 1) % len(READ)], len(answer)] += 1
                until_ns = 0
        assert answers.total() >= asked - 1, (asked, answers)
        return answers

    def control_frames(self) -> list[list[int]]:
        messages = message_set(self.vehicle.config.bus)
        ids = [one.spec.frame_id for one in (messages.command, messages.status)]
        return [[frame.timestamp_ns for frame in self.sent if frame.frame_id == one] for one in ids]

    def ask(self, request: bytes, seconds: float = 15.0) -> list[tuple[float, bytes]]:
        """Answers with the ms that they took, response-pending and the last one."""
        began_ns, answers = self.now_ns, list[tuple[float, bytes]]()
        self.send(request)
        while not answers or answers[-1][1][:1] + answers[-1][1][2:] == b"\x7f\x78":
            answers += [((self.now_ns - began_ns) / 1e6, answer) for answer in self.look()]
            assert self.now_ns - began_ns < seconds * 1e9, (request.hex(), answers)
        return answers

    def unlock(self, level: int) -> bytes:
        _, seed = self.ask(bytes([0x27, level]))[-1]
        return self.ask(bytes([0x27, level + 1]) + KEY.answer(Level(level), seed[2:]))[-1][1]


class BoardLine(Line):
    """A tester's connection by ISO-TP through the board's registers; its time is the board's."""

    def __init__(self, board: BoardEcu, bus: BusConfig = CONFIG.bus) -> None:
        super().__init__(self)
        self.server: Any = self
        self.is_reset = False
        self._board, self.now_ns = board, board.board.counter.now_ns
        self._response = bus.diagnosis.response
        self._end = Endpoint(isotp_settings(bus, is_tester=True))

    def power_on(self) -> None:
        """Nothing to be done: a reset is the firmware's own."""

    def request(self, _now_ns: int, payload: bytes) -> list[bytes]:
        self._end.send(payload)
        return []

    def tick(self, until_ns: int) -> list[bytes]:
        while (now_ns := self._board.board.counter.now_ns) < until_ns:
            for frame in self._board.advance(min(until_ns, now_ns + TICK_NS), self._end.poll(now_ns)):
                if frame.identifier == self._response:
                    self._end.receive(self._board.board.counter.now_ns, frame)
        return self._end.take()

    def provision(self, keys: bytes, image: bytes) -> None:
        bring(self.asking(), keys)
        assert self.flash(image).end is End.CONFIRMED

    def flash(self, image: bytes) -> Flashed:
        return Flashing(self.asking(), image).run()
