"""The tester's thread next to the control's: whatever the one waits for, the other goes on."""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from threading import Event

import pytest

from can_bridge.flashing.access_level import Level
from can_bridge.flashing.backing import RecordKind
from can_bridge.flashing.boot import BootReason
from can_bridge.flashing.folder_backing import FolderBacking
from can_bridge.flashing.report import decode
from can_bridge.isotp.endpoint import Endpoint, IsoTpSettings
from can_bridge.wire.frame import Frame
from contract.config.tree import Config
from ecu.daemon.store_service import DiagnosisThread
from ecu.flashable.flashable_ecu import FlashableEcu
from ecu.real_time import clock
from tests.can_bridge.flashing.store_ecu import KEY
from tests.can_bridge.uds.addresses import REQUEST_ID, RESPONSE_ID
from tests.ecu.daemon.conftest import wait_for
from tests.ecu.flashable.vehicle_ecu import Rig, image, provision

CONFIG = Config()


class SlowDisk(FolderBacking):
    """Keeps records only when it is let."""

    def __init__(self, folder: Path) -> None:
        super().__init__(folder)
        self.waits, self.let = Event(), Event()

    def keep(self, kind: RecordKind, record: bytes) -> None:
        self.waits.set()
        assert self.let.wait(10.0)
        super().keep(kind, record)


class AtTheOtherEnd:
    """A tester, with the wire in between."""

    def __init__(self, ecu: FlashableEcu) -> None:
        self.endpoint = Endpoint(IsoTpSettings(receive_id=RESPONSE_ID, send_id=REQUEST_ID))
        self.failures: list[BaseException] = []
        self.answers: list[bytes] = []
        self.thread = DiagnosisThread(ecu, self.hear, now_ns=clock.now_ns, failed=self.failures.append)

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
    rig = Rig(tmp_path / "ecu", CONFIG)
    ecu = FlashableEcu(backing_of(tmp_path / "ecu"), CONFIG, rig.equipment)
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
            assert len(ecu.control(10**9 + step * CONFIG.period_ns, [])) == 2
        assert tester.answers == []
        disks[-1].let.set()
        wait_for(lambda: tester.answers == [b"\x67\x02"])


def test_the_control_goes_on_while_a_reset_boots_and_then_with_what_was_booted(tmp_path: Path) -> None:
    with served(tmp_path) as (ecu, tester):
        now_ns = clock.now_ns() - CONFIG.period_ns * 4
        before = ecu.state.commands.counter
        for _ in range(3):
            ecu.control(now_ns := now_ns + CONFIG.period_ns, [])
        assert ecu.state.commands.counter == before + 3
        assert tester.ask(b"\x22\xf1\x8c") == b"\x62\xf1\x8c42"
        assert decode(tester.ask(b"\x22\xfd\x01")[3:]).reason is BootReason.CONFIRMED
        tester.ask(b"\x10\x02")
        assert tester.ask(b"\x11\x01") == b"\x51\x01"
        wait_for(lambda: ecu.resets == 1)
        # Until the control has taken over there is no one to ask.
        assert ecu.state.commands.counter == before + 3
        ecu.control(clock.now_ns(), [])
        assert ecu.state.commands.counter == 1
        assert tester.ask(b"\x22\xf1\x86") == b"\x62\xf1\x86\x01"


def test_what_ends_the_thread_is_reported(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(FlashableEcu, "service", lambda ecu, now_ns, frames: 1 // 0)
    with pytest.raises(AssertionError, match="ZeroDivisionError"), served(tmp_path) as (_, tester):
        tester.send(b"\x22\xf1\x8c")
        wait_for(lambda: tester.failures)
