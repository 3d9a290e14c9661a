"""`stillwake flash-keys` against an ECU with a store on a virtual bus."""

import os
from pathlib import Path

import pytest
from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey

pytest.importorskip("udsoncan")
pytest.importorskip("isotp")

from can_bridge.secoc.key import write_key
from contract.config.vehicle import BusConfig
from tests.can_bridge.flashing.releases import RELEASE, SECOND, keys, provisioned
from tests.can_bridge.flashing.store_ecu import SECRET, StoreEcu
from tests.can_bridge.tester.served import served


def test_a_newer_list_is_taken_and_nothing_else(cli, tmp_path):
    write_key(tmp_path / "access.key", SECRET)
    bus = BusConfig(interface="virtual", channel=f"flash-keys-{os.getpid()}")
    memory = provisioned()
    ecu = StoreEcu(lambda: memory)

    def brought(name: str, raw: bytes | None, *more: Ed25519PrivateKey) -> tuple[int, str, str]:
        path: Path = tmp_path / name
        if raw is not None:
            path.write_bytes(raw)
        outcome = cli("flash-keys", path, "--bus", f"virtual:{bus.channel}", "--access", tmp_path / "access.key")
        return outcome.code, outcome.out.strip(), outcome.err

    with served(ecu, bus):
        assert brought("good", keys(3, RELEASE, SECOND))[:2] == (0, "the ECU has key list 3, and had 1")
        # An older one, one without the key of the confirmed release, one of another root key.
        for raw in (keys(2, RELEASE), keys(4, SECOND), keys(5)[:-1]):
            code, _, err = brought("bad", raw)
            assert (code, "a version above 3" in err) == (6, True)
    assert ecu.store.keys is not None and ecu.store.keys.version == 3
    for name, content, words in (
        ("empty", b"", "1 to 4092 bytes"),
        ("long", bytes(4093), "1 to 4092 bytes"),
        ("none", None, "No such file"),
    ):
        code, _, err = brought(name, content)
        assert (code, words in err) == (1, True), name
