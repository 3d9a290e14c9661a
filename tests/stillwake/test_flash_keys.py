"""`stillwake flash-keys` and `stillwake calibrate` against an ECU with a store on a virtual bus."""

import os
from collections.abc import Iterator
from itertools import count
from pathlib import Path

import pytest
from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey

pytest.importorskip("udsoncan")
pytest.importorskip("isotp")

from can_bridge.secoc.key import write_key
from contract.config.loading import load_config
from contract.release import signing
from contract.release.key_list import KeyList, encode
from contract.shipped import BUNDLE
from firmware_sim.ecu.flashable.flashable_ecu import FlashableEcu
from tests.can_bridge.flashing.releases import RELEASE, ROOT
from tests.can_bridge.flashing.store_ecu import SECRET
from tests.stillwake.flash_bench import powered, provision

NUMBERS = count()


@pytest.fixture
def channel() -> str:
    return f"flash-keys-{os.getpid()}-{next(NUMBERS)}"


@pytest.fixture
def ecu(tmp_path: Path, channel: str) -> Iterator[list[FlashableEcu]]:
    """With the shipped release, and a key list of version 1."""
    config = load_config(overrides=["bus.interface=virtual", f"bus.channel={channel}"])
    provision(tmp_path / "ecu", BUNDLE, config)
    with powered(tmp_path / "ecu", config) as made:
        yield made


@pytest.fixture
def asked(tmp_path: Path, channel: str) -> tuple[object, ...]:
    """The options that reach it."""
    write_key(tmp_path / "access.key", SECRET)
    return "--bus", f"virtual:{channel}", "--access", tmp_path / "access.key"


def listed(folder: Path, version: int, *keys: signing.PublicKey, root: Ed25519PrivateKey = ROOT) -> Path:
    path = folder / f"{version}.keys"
    path.write_bytes(encode(KeyList(version=version, keys=frozenset(keys)), root))
    return path


@pytest.mark.slow
def test_a_newer_list_is_taken_and_an_older_one_is_not(cli, ecu, asked, tmp_path):
    maker = signing.public_key(RELEASE)
    outcome = cli("flash-keys", listed(tmp_path, 3, signing.project_key()), *asked)
    assert (outcome.code, outcome.out.strip()) == (0, "the ECU has key list 3, and had 1")
    assert ecu[0].store.keys.keys == {signing.project_key()}
    for path in (
        listed(tmp_path, 2, signing.project_key(), maker),
        listed(tmp_path, 4, maker),
        listed(tmp_path, 5, signing.project_key(), maker, root=RELEASE),
    ):
        outcome = cli("flash-keys", path, *asked)
        assert (outcome.code, "a version above 3" in outcome.err) == (6, True)
    assert ecu[0].store.keys.version == 3


def test_a_file_that_is_none_is_refused_at_once(cli, asked, tmp_path):
    (tmp_path / "empty").touch()
    (tmp_path / "long").write_bytes(bytes(4093))
    for name, words in (("empty", "1 to 4092 bytes"), ("long", "1 to 4092 bytes"), ("none", "No such file")):
        outcome = cli("flash-keys", tmp_path / name, *asked)
        assert outcome.code == 1
        assert words in outcome.err


def test_a_goal_is_written_over_the_bus_and_stored(cli, ecu, asked):
    outcome = cli("calibrate", *asked, "lift=0.5", "action_limit=0.05", "--store")
    assert (outcome.code, "a calibration is stored" in outcome.out) == (0, True)
    outcome = cli("calibrate", *asked[:2])
    line = next(line.split() for line in outcome.out.splitlines() if "action_limit" in line)
    assert line == ["action_limit", "0.05", "0.00375", "0.075", "0.075"]
    assert cli("calibrate", *asked, "--revert").code == 0
    assert "nothing is stored" in cli("calibrate", *asked[:2]).out
