"""An ECU with a store in a folder, and a tester that talks to it frame by frame: no bus, no process, time by hand."""

from collections.abc import Sequence
from dataclasses import replace
from functools import cache
from pathlib import Path
from random import Random
from typing import Any

import numpy as np
from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey

from can_bridge.flashing.folder_backing import FolderBacking
from can_bridge.flashing.verdicts import Verdict
from can_bridge.isotp.endpoint import Endpoint
from can_bridge.wire import codec
from can_bridge.wire.frame import Frame
from can_bridge.wire.message_specs import ECU_STATUS, JET_COMMAND
from can_bridge.wire.messages import EcuStatus, JetCommand, Mode
from contract.config.tree import Config
from contract.config.vehicle import BenefitCheckConfig, EcuConfig, SensorCheckConfig
from contract.release import bundle as bundles
from contract.release import signing
from contract.release.checks import Bundle
from contract.release.container import image_of
from contract.shipped import BUNDLE
from ecu.flashable.equipment import Equipment
from ecu.flashable.flashable_ecu import FlashableEcu
from ecu.flashable.links import isotp_settings
from tests.can_bridge.flashing import releases
from tests.can_bridge.flashing.store_ecu import KEY, FlashingSteps
from tests.ecu.conftest import ByHand, RecordingController

MS = 1_000_000
# Made-up pressures are no wake: the checks of the sensors and of the benefit would shut the jets.
UNCHECKED = Config(
    ecu=EcuConfig(sensor_check=SensorCheckConfig(enabled=False), benefit_check=BenefitCheckConfig(enabled=False))
)
SELF_TEST, ACTIVATE, CONFIRM_ROUTINE, REVERT = (b"\x31\x01\x02" + bytes([low]) for low in (4, 5, 6, 7))


@cache
def shipped() -> Bundle:
    return bundles.load(BUNDLE)


@cache
def image(name: str, security_version: int = 1, key: Ed25519PrivateKey = releases.RELEASE, **changes: Any) -> bytes:
    """The shipped release under another name, signed by another key."""
    manifest = replace(shipped().manifest, name=name, security_version=security_version, **changes)
    return image_of(bundles.pack(manifest, shipped().files, key))


def provision(folder: Path, first: bytes | None) -> FolderBacking:
    return releases.provision(FolderBacking(folder), first)


class Log(list[tuple[str, str, dict[str, Any]]]):
    def __call__(self, event: str, line: str, **fields: Any) -> None:
        self.append((event, line, fields))

    def names(self) -> list[str]:
        return [event for event, _, _ in self]


class Rig(FlashingSteps):
    """Steps once a period, and looks at diagnosis each millisecond; frames arrive the moment they are sent."""

    def __init__(self, folder: Path, config: Config | None = None, controller_of: Any = None, **others: Any) -> None:
        self.config = Config() if config is None else config
        self.log = Log()
        self.equipment = Equipment(
            root=signing.public_key(releases.ROOT),
            access=KEY,
            random_bytes=Random(1).randbytes,
            hardware="bench",
            serial="42",
            software="0.7.0",
            controller_of=(lambda bundle: RecordingController()) if controller_of is None else controller_of,
            log=self.log,
        )
        self.folder, self.others = folder, others
        self.now_ns = self.due_ns = MS
        self.vehicle = ByHand(self.config, others.get("authentication"))
        self.tester = Endpoint(isotp_settings(self.config.bus, is_tester=True))
        self.request: bool | None = None
        self.answers: list[bytes] = []
        self.commands: list[JetCommand] = []
        self.statuses: list[EcuStatus] = []
        self.sent: list[Frame] = []
        self.extra: Sequence[Frame] = ()
        self.controls: list[tuple[int, list[Frame], list[Frame]]] = []
        self.power_on()

    def power_on(self) -> None:
        self.ecu = FlashableEcu(FolderBacking(self.folder), self.config, self.equipment, **self.others)

    def millisecond(self) -> None:
        if self.now_ns >= self.due_ns:
            self.due_ns += self.config.period_ns
            frames = [] if self.request is None else [self.pressure(self.request), self.vehicle.at_speed(1.0)]
            commanded = self.ecu.step(self.now_ns, frames)
            self.controls.append((self.now_ns, frames, commanded))
            self.take(commanded)
        self.take(self.ecu.service(self.now_ns, [*self.extra, *self.tester.poll(self.now_ns)]))
        self.now_ns += MS

    def take(self, frames: Sequence[Frame]) -> None:
        for frame in frames:
            if frame.identifier == self.config.bus.diagnosis.response:
                self.tester.receive(self.now_ns, frame)
            elif frame.frame_id == JET_COMMAND.frame_id:
                command = codec.parse_jet_command(frame.data)
                assert command is not None
                self.commands.append(command)
            elif frame.frame_id == ECU_STATUS.frame_id:
                status = codec.parse_ecu_status(frame.data)
                assert status is not None
                self.statuses.append(status)
        self.sent += frames
        self.answers += self.tester.take()

    def run(self, milliseconds: int) -> None:
        for _ in range(milliseconds):
            self.millisecond()

    def run_asking(self, request: bool | None, milliseconds: int) -> None:
        self.request = request
        self.run(milliseconds)

    def into_control(self) -> None:
        self.run_asking(False, 100)
        self.run_asking(True, 1300)
        assert self.statuses[-1].state is Mode.CONTROL

    def pressure(self, enable: bool) -> Frame:
        self.vehicle.now_ns = self.now_ns
        return self.vehicle.pressures(0.1 * (1 + 0.1 * (self.vehicle.frames_sent % 7) + np.arange(4)), asks=enable)

    def ask(self, request: bytes, /, patience_ms: int = 30_000) -> bytes:
        """The final answer to a request; response-pending is waited out."""
        self.tester.send(request)
        for _ in range(patience_ms):
            self.millisecond()
            while self.answers:
                answer = self.answers.pop(0)
                if answer[:1] != b"\x7f" or answer[2] != 0x78:
                    return answer
        raise AssertionError(f"no answer to {request[:8].hex()}")

    def reset(self) -> None:
        before = self.ecu.resets
        self.good(b"\x11\x01")
        while self.ecu.resets == before or self.ecu.cycle.store.last_boot is None:
            self.millisecond()
        self.run(2 * self.config.period_ns // MS)

    def start(self, raw: bytes) -> None:
        """An image written, and started on trial."""
        assert self.write(raw) is Verdict.GOOD
        self.good(b"\x31\x01\x02\x05")
        self.reset()
