import hashlib
from collections.abc import Callable
from typing import Any

import pytest
from udsoncan.client import Client

from can_bridge.flashing.state import Phase
from can_bridge.tester.sequence import Flashed, Options, flash
from can_bridge.uds.access_key import AccessKey
from can_bridge.uds.services import Did
from contract.release import bundle
from contract.release.bundle import dbc_sha256
from contract.release.container import read_files
from contract.release.image import image_of
from contract.shipped import BUNDLE
from tests.can_bridge.tester.played_ecu import SECRET, Held, Line, Played, VirtualTime

SHIPPED = image_of(read_files(BUNDLE))


def played() -> Played:
    """With a confirmed release named old, and room for the shipped one."""
    manifest = bundle.load(BUNDLE).manifest
    period_ns = manifest.operating_point.period_ns(manifest.control_period)
    old = SHIPPED[:100]
    return Played(
        running=Held(image=old, announced=(100, hashlib.sha256(old).digest()), phase=Phase.CONFIRMED, name="old"),
        dids={
            Did.HARDWARE: b"bench",
            Did.SERIAL_NUMBER: b"7",
            Did.SOFTWARE_VERSION: b"0.6",
            Did.DBC_SHA256: bytes.fromhex(dbc_sha256()),
            Did.CAPACITY: (2**20).to_bytes(4, "big"),
            Did.PERIOD_NS: period_ns.to_bytes(8, "big"),
        },
    )


@pytest.fixture
def kept() -> Played:
    return played()


@pytest.fixture
def time() -> VirtualTime:
    return VirtualTime()


@pytest.fixture
def line(kept: Played, time: VirtualTime) -> Line:
    return Line(kept, time)


@pytest.fixture
def flashing(line: Line, time: VirtualTime) -> Callable[..., Flashed]:
    def call(image: bytes = SHIPPED, *, secret: bytes = SECRET, **options: Any) -> Flashed:
        others = {name: options.pop(name) for name in ("judge", "progress", "say") if name in options}
        return flash(
            Client(line),
            image,
            key=AccessKey(secret).answer,
            options=Options(**options),
            clock=time.clock,
            sleep=time.sleep,
            **others,
        )

    return call
