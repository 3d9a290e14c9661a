"""The scanners of scapy against the ECU, frame by frame: they find the service table, and disturb nothing."""

from collections import deque
from collections.abc import Iterator
from contextlib import contextmanager
from threading import Event, Thread
from typing import Any

import pytest

from can_bridge.uds.services import LEVELS, ROUTINES, SERVICES, Did, Nrc, Session
from can_bridge.wire.frame import Frame
from can_bridge.wire.messages import Mode
from tests.ecu.flashable.vehicle_ecu import Rig

pytest.importorskip("scapy")

from scapy.automaton import ObjectPipe, select_objects
from scapy.contrib.automotive import uds_scan
from scapy.contrib.automotive.ecu import EcuState
from scapy.contrib.automotive.uds import UDS
from scapy.contrib.automotive.xcp.scanner import XCPOnCANScanner
from scapy.contrib.automotive.xcp.xcp import XCPOnCAN
from scapy.contrib.isotp import ISOTPSoftSocket, isotp_scan
from scapy.layers.can import CANFD
from scapy.supersocket import SuperSocket

from tests.can_bridge.uds.addresses import COMMAND_ID, REQUEST_ID, RESPONSE_ID, XCP_RESPONSE_ID

pytestmark = pytest.mark.slow  # the scanners wait in real time


class EcuSocket(SuperSocket):  # type: ignore[misc]
    """Scapy's end of a bus with the ECU alone, whose milliseconds pass as fast as they can."""

    def __init__(self, rig: Rig, kind: Any = CANFD) -> None:
        self.rig, self.kind = rig, kind
        self.to_ecu: deque[Frame] = deque()
        self.from_ecu: Any = ObjectPipe()
        self.closed, self._stop, self.faults = False, Event(), list[BaseException]()
        self._thread = Thread(target=self._run, daemon=True)
        self._thread.start()

    def _run(self) -> None:
        try:
            while not self._stop.wait(0.0002):
                self.rig.extra = [self.to_ecu.popleft() for _ in range(len(self.to_ecu))]
                self.rig.sent.clear()
                self.rig.millisecond()
                for frame in self.rig.sent:
                    if frame.identifier in self.rig.config.bus.diagnosis.names:
                        seen = CANFD(identifier=frame.frame_id, flags=0, fd_flags=4, data=frame.data)
                        self.from_ecu.send(bytes(seen))
        except BaseException as error:  # noqa: BLE001  (the test fails by it below)
            self.faults.append(error)

    def send(self, packet: Any) -> int:
        raw = bytes(packet)
        data = raw[8 : 8 + raw[4]]
        self.to_ecu.append(Frame(frame_id=packet.identifier, data=data, timestamp_ns=self.rig.now_ns))
        return len(data)

    def recv(self, *args: Any, **others: Any) -> Any:
        return self.kind(self.from_ecu.recv())

    @staticmethod
    def select(sockets: Any, remain: float | None = None) -> Any:
        pipes = {one.from_ecu if isinstance(one, EcuSocket) else one: one for one in sockets}
        return [pipes[ready] for ready in select_objects(list(pipes), remain)]

    def close(self) -> None:
        self.closed = True
        self._stop.set()
        self._thread.join()


@contextmanager
def scanned(rig: Rig, *, mode: Mode) -> Iterator[EcuSocket]:
    """The bus while it is scanned; the jets must stay as they are in this mode, in every control period."""
    if mode is Mode.CONTROL:
        rig.into_control()
    else:
        rig.run_asking(False, 1500)
    rig.statuses.clear()
    rig.commands.clear()
    bus = EcuSocket(rig)
    yield bus
    bus.close()
    assert bus.faults == []
    assert {status.state for status in rig.statuses} == {mode}
    assert {command.enable for command in rig.commands} == {mode is Mode.CONTROL}


def asked(bus: EcuSocket, enumerator: Any, session: Session = Session.DEFAULT, **others: Any) -> dict[bytes, bytes]:
    """Each request of an enumerator in a session, and its answer."""
    with ISOTPSoftSocket(bus, tx_id=REQUEST_ID, rx_id=RESPONSE_ID, fd=True, basecls=UDS) as socket:
        assert socket.sr1(UDS(bytes([0x10, session])), timeout=2, verbose=False).service == 0x50
        enumerator.execute(socket, EcuState(session=session), timeout=2, **others)
    assert enumerator.results
    return {bytes(one.req): bytes(one.resp) for one in enumerator.results if one.resp is not None}


def refused(answers: dict[bytes, bytes], *codes: Nrc) -> set[bytes]:
    return {request for request, answer in answers.items() if answer[0] == 0x7F and answer[2] in codes}


def test_isotp_and_xcp_are_found_where_they_are(rig):
    with scanned(rig, mode=Mode.CONTROL) as bus:
        (found,) = isotp_scan(bus, range(0x7D9, 0x7E8), noise_listen_time=0.1, sniff_time=0.02, fd=True)
        found.close()
        assert (found.tx_id, found.rx_id) == (REQUEST_ID, RESPONSE_ID)
        bus.kind = XCPOnCAN
        slaves = XCPOnCANScanner(bus, range(0x7C8, 0x7E0), sniff_time=0.02).scan_with_connect()
        assert [tuple(one) for one in slaves] == [(COMMAND_ID, XCP_RESPONSE_ID)]


def test_what_scanners_find_amid_control_is_the_table(rig):
    """Services, identifiers and sessions, each by its answer; nothing they ask for changes the control."""
    with scanned(rig, mode=Mode.CONTROL) as bus:
        answers = asked(bus, uds_scan.UDS_ServiceEnumerator())
        assert {r[0] for r in answers.keys() - refused(answers, Nrc.SERVICE_NOT_SUPPORTED)} == set(SERVICES)
        elsewhere = {one for one, permission in SERVICES.items() if Session.DEFAULT not in permission.sessions}
        assert {request[0] for request in refused(answers, Nrc.SERVICE_NOT_IN_SESSION)} == elsewhere
        answers = asked(bus, uds_scan.UDS_RDBIEnumerator(), scan_range=[*range(0xF184, 0xF198), *range(0xFCFC, 0xFD18)])
        assert {int.from_bytes(r[1:3], "big") for r in answers.keys() - refused(answers, Nrc.OUT_OF_RANGE)} == {*Did}
        answers = asked(bus, uds_scan.UDS_DSCEnumerator(), scan_range=[2, *range(4, 0x20)], overwrite_timeout=False)
        assert refused(answers, Nrc.CONDITIONS_NOT_CORRECT) == {b"\x10\x02"}, "the jets run"
        assert len(refused(answers, Nrc.SUB_FUNCTION_NOT_SUPPORTED)) == 0x20 - 4


def test_levels_and_routines_found_while_the_jets_are_shut_are_the_tables(rig):
    # This scanner ends at the first seed: the level of the session comes last.
    for session, order in ((Session.EXTENDED, 1), (Session.PROGRAMMING, -1)):
        with scanned(rig, mode=Mode.OFF) as bus:
            answers = asked(bus, uds_scan.UDS_SAEnumerator(), session, scan_range=[1, *range(5, 0x20, 2), 3][::order])
            levels = {one for one, permission in LEVELS.items() if session in permission.sessions}
            assert {r[1] for r, answer in answers.items() if answer[0] == 0x67} == levels
            assert {r[1] for r in refused(answers, Nrc.SUB_FUNCTION_NOT_IN_SESSION)} == LEVELS.keys() - levels
            near = [*range(0x1FE, 0x208), *range(0xFEFE, 0xFF06)]
            answers = asked(bus, uds_scan.UDS_RCStartEnumerator(), session, scan_range=near)
            there = {int.from_bytes(r[2:4], "big") for r in answers.keys() - refused(answers, Nrc.OUT_OF_RANGE)}
            assert there == {one for one, permission in ROUTINES.items() if session in permission.sessions}
