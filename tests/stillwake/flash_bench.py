"""An ECU as vehicles have it, on a virtual bus of this process: in a thread, in real time, its store in a folder."""

import random
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from threading import Event, Thread

from can_bridge.bus.backends.python_can import PythonCanBus
from can_bridge.flashing.folder_backing import FolderBacking
from can_bridge.uds.services import REQUEST_ID
from can_bridge.wire.message_specs import PRESSURE
from contract.config.tree import Config
from contract.release import signing
from contract.release.container import read_files
from contract.release.image import image_of
from contract.release.key_list import KeyList, encode
from contract.runtime.onnx_session import OnnxController
from firmware_sim.ecu.flashable.fitting import Fitting
from firmware_sim.ecu.flashable.flashable_ecu import FlashableEcu, is_diagnostic
from firmware_sim.ecu.flashable.supplies import Supplies
from tests.can_bridge.flashing import releases
from tests.can_bridge.flashing.releases import RELEASE, ROOT
from tests.can_bridge.flashing.store_ecu import KEY


def provision(folder: Path, first: Path | None, config: Config) -> None:
    """A store as at production, with a release in it or none."""
    listed = KeyList(version=1, keys=frozenset({signing.public_key(RELEASE), signing.project_key()}))
    releases.provision(
        FolderBacking(folder),
        None if first is None else image_of(read_files(first)),
        keys=encode(listed, ROOT),
        fits=Fitting(config, OnnxController.of).fits,
    )


@contextmanager
def powered(folder: Path, config: Config) -> Iterator[list[FlashableEcu]]:
    """Yields the ECU once it is there."""
    stop, faults, made = Event(), list[BaseException](), list[FlashableEcu]()
    is_there = Event()

    def run() -> None:
        try:
            with PythonCanBus.open(config.bus, accept={REQUEST_ID, PRESSURE.frame_id}) as bus:
                made.append(_ecu(folder, config))
                is_there.set()
                _pump(made[0], bus, config.period_ns, stop)
        except BaseException as error:  # noqa: BLE001  (the test fails by it below)
            faults.append(error)
            is_there.set()

    thread = Thread(target=run, daemon=True)
    thread.start()
    is_there.wait(30.0)
    try:
        yield made
    finally:
        stop.set()
        thread.join()
    assert faults == []


def _ecu(folder: Path, config: Config) -> FlashableEcu:
    root = signing.public_key(ROOT)
    supplies = Supplies(root=root, access=KEY, random_bytes=random.randbytes, hardware="bench", serial="42")
    return FlashableEcu(FolderBacking(folder), config, supplies)


def _pump(ecu: FlashableEcu, bus: PythonCanBus, period_ns: int, stop: Event) -> None:
    due_ns = time.monotonic_ns()
    waiting = []
    while not stop.is_set():
        frame = bus.receive(0.0 if ecu.is_busy else 0.002)
        now_ns = time.monotonic_ns()
        if frame is not None and not is_diagnostic(frame):
            waiting.append(frame)
        if now_ns >= due_ns:
            due_ns += period_ns
            for sent in ecu.control(now_ns, waiting):
                bus.send(sent)
            waiting = []
        for sent in ecu.service(now_ns, [frame] if frame is not None and is_diagnostic(frame) else []):
            bus.send(sent)
