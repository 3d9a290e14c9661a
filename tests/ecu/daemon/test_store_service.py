"""The process of an ECU that can be flashed, and the tester's thread next to the control's."""

import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from threading import Event

import pytest

from can_bridge.bus.backends.python_can import PythonCanBus
from can_bridge.flashing.backing import MediumError, RecordKind
from can_bridge.flashing.folder_backing import FolderBacking
from can_bridge.flashing.report import decode
from can_bridge.flashing.state import Level
from can_bridge.flashing.store import BootReason
from can_bridge.isotp.endpoint import Endpoint, IsoTpSettings
from can_bridge.wire.frame import Frame
from contract.config.diagnosis import DiagnosisConfig
from contract.config.tree import Config
from contract.config.vehicle import BusConfig
from contract.release import signing
from ecu.daemon.process import ProcessOptions
from ecu.daemon.store_service import DiagnosisThread, serve_store
from ecu.flashable.ecu_folder import EcuFolder
from ecu.flashable.flashable_ecu import FlashableEcu
from ecu.real_time import clock
from ecu.real_time.privileges import Wanted
from tests.can_bridge.flashing.releases import ROOT
from tests.can_bridge.flashing.store_ecu import KEY
from tests.can_bridge.uds.addresses import REQUEST_ID, RESPONSE_ID
from tests.ecu.daemon.conftest import wait_for
from tests.ecu.daemon.driving import PATIENCE_S
from tests.ecu.flashable.vehicle_ecu import Rig, image, provision

USUAL = DiagnosisConfig()


def serve(tmp_path: Path, is_stopped: Callable[[PythonCanBus], bool], ids: DiagnosisConfig = USUAL) -> list[str]:
    """Until it is stopped or ends by itself; the log."""
    provision(tmp_path / "ecu", None)
    bus = BusConfig(interface="virtual", channel=str(tmp_path), diagnosis=ids)
    lines: list[str] = []
    with PythonCanBus.open(bus, accept={ids.response}) as tester:
        serve_store(
            EcuFolder(folder=tmp_path / "ecu", root=signing.public_key(ROOT), hardware="bench", serial="42"),
            KEY,
            Config(bus=bus),
            ProcessOptions(wanted=Wanted(priority=0, lock_memory=False, without_collector=False), environment={}),
            software="0.7.0",
            is_stopped=lambda: is_stopped(tester),
            write=lines.append,
        )
    return lines


def fail(*_: object) -> None:
    raise MediumError("the disk does not answer")


def test_a_reset_that_fails_ends_the_process_so_that_another_one_boots(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Asked under identifiers of 29 bits, of which one is functional."""
    monkeypatch.setattr(FlashableEcu, "_reset", fail)
    ids = DiagnosisConfig(request_id="0x18DA5AF1", response_id="0x18DAF15A", functional_id="0x18DB33F1")
    until, answers = time.monotonic() + PATIENCE_S, list[Frame]()
    # A tester that is present, a session, a reset.
    requests = [(ids.functional, b"\x02\x3e\x00"), (ids.request, b"\x02\x10\x02"), (ids.request, b"\x02\x11\x01")]

    def is_stopped(tester: PythonCanBus) -> bool:
        if requests:
            to, request = requests.pop(0)
            assert to is not None
            tester.send(Frame(frame_id=to.number, is_extended=to.is_extended, data=request.ljust(8, b"\xcc")))
        answers.extend(tester.receive_all())
        return time.monotonic() > until

    with pytest.raises(MediumError, match="does not answer"):
        serve(tmp_path, is_stopped, ids)
    assert time.monotonic() < until
    assert (answers[0].identifier, answers[0].data[:3]) == (ids.response, b"\x02\x7e\x00")


def test_otherwise_the_control_goes_on(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(FlashableEcu, "service", fail)
    periods = []

    def is_stopped(tester: PythonCanBus) -> bool:
        periods.append(0)
        return len(periods) > 20

    lines = serve(tmp_path, is_stopped)
    assert len(periods) == 21
    assert any("control continues" in line for line in lines)


CONFIG = Config()


class SlowDisk(FolderBacking):
    def __init__(self, folder: Path) -> None:
        super().__init__(folder)
        self.waits, self.let = Event(), Event()

    def keep(self, kind: RecordKind, record: bytes) -> None:
        self.waits.set()
        assert self.let.wait(10.0)
        super().keep(kind, record)


class AtTheOtherEnd:
    def __init__(self, ecu: FlashableEcu) -> None:
        self.endpoint = Endpoint(IsoTpSettings(receive_id=RESPONSE_ID, send_id=REQUEST_ID))
        self.failures: list[BaseException] = []
        self.answers: list[bytes] = []
        self.thread = DiagnosisThread(ecu, self.hear, self.failures.append)

    def hear(self, frames: Sequence[Frame]) -> None:
        for frame in frames:
            self.endpoint.receive(clock.now_ns(), frame)
        self.answers += self.endpoint.take()
        for frame in self.endpoint.poll(clock.now_ns()):
            self.thread.put(frame)

    def send(self, request: bytes) -> None:
        self.endpoint.send(request)
        for frame in self.endpoint.poll(clock.now_ns()):
            self.thread.put(frame)

    def ask(self, request: bytes) -> bytes:
        self.answers.clear()
        self.send(request)
        wait_for(lambda: any(answer[:1] != b"\x7f" or answer[2] != 0x78 for answer in self.answers))
        return self.answers[-1]


@contextmanager
def served(tmp_path: Path, backing_of=FolderBacking) -> Iterator[tuple[FlashableEcu, AtTheOtherEnd]]:
    provision(tmp_path / "ecu", image("first"))
    ecu = FlashableEcu(backing_of(tmp_path / "ecu"), CONFIG, Rig(tmp_path / "ecu", CONFIG).equipment)
    tester = AtTheOtherEnd(ecu)
    with tester.thread:
        yield ecu, tester
    assert tester.failures == [], tester.failures


def test_a_disk_that_hangs_does_not_come_into_a_control_period(tmp_path: Path) -> None:
    disks: list[SlowDisk] = []

    def slow(folder: Path) -> SlowDisk:
        disks.append(SlowDisk(folder))
        return disks[-1]

    with served(tmp_path, slow) as (ecu, tester):
        tester.ask(b"\x10\x02")
        seed = tester.ask(b"\x27\x01")[2:]
        # The attempt is written before the answer.
        tester.answers.clear()
        tester.send(b"\x27\x02" + KEY.answer(Level.PROGRAMMING, seed))
        assert disks[-1].waits.wait(10.0)
        for step in range(50):
            assert len(ecu.step(10**9 + step * CONFIG.period_ns, [])) == 2
        assert tester.answers == []
        disks[-1].let.set()
        wait_for(lambda: tester.answers == [b"\x67\x02"])


def test_the_control_goes_on_while_a_reset_boots_and_then_with_what_was_booted(tmp_path: Path) -> None:
    with served(tmp_path) as (ecu, tester):
        now_ns = clock.now_ns() - CONFIG.period_ns * 4
        before = ecu.state.commands.counter
        for _ in range(3):
            ecu.step(now_ns := now_ns + CONFIG.period_ns, [])
        assert ecu.state.commands.counter == before + 3
        assert tester.ask(b"\x22\xf1\x8c") == b"\x62\xf1\x8c42"
        assert decode(tester.ask(b"\x22\xfd\x01")[3:]).reason is BootReason.CONFIRMED
        tester.ask(b"\x10\x02")
        assert tester.ask(b"\x11\x01") == b"\x51\x01"
        wait_for(lambda: ecu.resets == 1)
        # Until the control has taken over there is no one to ask.
        assert ecu.state.commands.counter == before + 3
        ecu.step(clock.now_ns(), [])
        assert ecu.state.commands.counter == 1
        assert tester.ask(b"\x22\xf1\x86") == b"\x62\xf1\x86\x01"
