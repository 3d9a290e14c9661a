"""An ECU as vehicles have it, on a virtual bus of this process: in a thread, in real time, its store in a folder."""

import random
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from threading import Event, Thread

from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey

from can_bridge.bus.backends.python_can import PythonCanBus
from can_bridge.flashing.folder_backing import FolderBacking
from can_bridge.flashing.store import Store
from can_bridge.uds.access_key import AccessKey
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

ROOT = Ed25519PrivateKey.from_private_bytes(b"root" * 8)
MAKER = Ed25519PrivateKey.from_private_bytes(b"make" * 8)
SECRET = bytes(range(1, 17))


def provision(folder: Path, first: Path | None, config: Config) -> None:
    """A store as at production, with a release in it or none."""
    keys = KeyList(version=1, keys=frozenset({signing.public_key(MAKER), signing.project_key()}))
    Store.provision(
        FolderBacking(folder),
        root=signing.public_key(ROOT),
        keys=encode(keys, ROOT),
        image=None if first is None else image_of(read_files(first)),
        hardware="bench",
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
    supplies = Supplies(
        root=signing.public_key(ROOT),
        access=AccessKey(SECRET),
        random_bytes=random.randbytes,
        hardware="bench",
        serial="42",
        software="0.7.0",
    )
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
