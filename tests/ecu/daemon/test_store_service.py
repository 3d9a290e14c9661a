"""The process of an ECU that can be flashed, on a `virtual` bus: what becomes of it when diagnosis ends."""

import time
from collections.abc import Callable
from pathlib import Path

import pytest

from can_bridge.bus.backends.python_can import PythonCanBus
from can_bridge.flashing.backing import MediumError
from can_bridge.wire.frame import Frame
from contract.config.diagnosis import DiagnosisConfig
from contract.config.tree import Config
from contract.config.vehicle import BusConfig
from contract.release import signing
from ecu.daemon.process import ProcessOptions
from ecu.daemon.store_service import serve_store
from ecu.flashable.ecu_folder import EcuFolder
from ecu.flashable.flashable_ecu import FlashableEcu
from ecu.real_time.privileges import Wanted
from tests.can_bridge.flashing.releases import ROOT
from tests.can_bridge.flashing.store_ecu import KEY
from tests.can_bridge.uds.addresses import REQUEST_ID
from tests.ecu.daemon.driving import PATIENCE_S
from tests.ecu.flashable.vehicle_ecu import provision

USUAL = DiagnosisConfig()
SESSION, RESET = b"\x02\x10\x02", b"\x02\x11\x01"


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


def ask(tester: PythonCanBus, request: bytes) -> None:
    tester.send(Frame(frame_id=REQUEST_ID, data=request.ljust(8, b"\xcc")))


def fail(*_: object) -> None:
    raise MediumError("the disk does not answer", 0)


def test_a_reset_that_fails_ends_the_process_so_that_another_one_boots(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(FlashableEcu, "_reset", fail)
    until, requests = time.monotonic() + PATIENCE_S, [SESSION, RESET]

    def is_stopped(tester: PythonCanBus) -> bool:
        if requests:
            ask(tester, requests.pop(0))
        return time.monotonic() > until

    with pytest.raises(MediumError, match="does not answer"):
        serve(tmp_path, is_stopped)
    assert time.monotonic() < until


def test_otherwise_the_control_goes_on(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(FlashableEcu, "service", fail)
    periods = []

    def is_stopped(tester: PythonCanBus) -> bool:
        periods.append(0)
        return len(periods) > 20

    lines = serve(tmp_path, is_stopped)
    assert len(periods) == 21
    assert any("control continues" in line for line in lines)


def test_it_is_asked_under_identifiers_of_29_bits_and_by_a_functional_one(tmp_path: Path) -> None:
    ids = DiagnosisConfig(request_id="0x18DA5AF1", response_id="0x18DAF15A", functional_id="0x18DB33F1")
    until, answers = time.monotonic() + PATIENCE_S, list[Frame]()
    requests = [(ids.functional, b"\x02\x7e\x00"), (ids.functional, b"\x02\x3e\x00"), (ids.request, b"\x02\x3e\x80")]

    def is_stopped(tester: PythonCanBus) -> bool:
        nonlocal requests
        for to, request in requests:
            assert to is not None
            tester.send(Frame(frame_id=to.number, is_extended=to.is_extended, data=request.ljust(8, b"\xcc")))
        requests = []
        answers.extend(tester.receive_all())
        return bool(answers) or time.monotonic() > until

    serve(tmp_path, is_stopped, ids)
    assert [(one.identifier, one.data[:3]) for one in answers] == [(ids.response, b"\x02\x7e\x00")]
