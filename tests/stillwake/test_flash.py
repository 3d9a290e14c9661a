"""`stillwake flash` as a user calls it, against an ECU with a store on a virtual bus."""

import os
from collections.abc import Callable, Iterator
from dataclasses import replace
from itertools import count
from pathlib import Path
from typing import Any

import pytest
from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey

from can_bridge.secoc.key import write_key
from contract.config.loading import load_config
from contract.config.tree import Config
from contract.release import bundle
from contract.shipped import BUNDLE
from tests.can_bridge.flashing.releases import RELEASE
from tests.can_bridge.flashing.store_ecu import SECRET
from tests.stillwake.flash_bench import powered, provision

NUMBERS = count()


@pytest.fixture(scope="module")
def releases(tmp_path_factory: pytest.TempPathFactory) -> Callable[..., Path]:
    """The shipped release under other names, signed by another key."""
    folder = tmp_path_factory.mktemp("releases")
    shipped = bundle.load(BUNDLE)

    def make(name: str, key: Any = RELEASE, **changes: Any) -> Path:
        path = folder / name
        if not path.exists():
            bundle.write(path, replace(shipped.manifest, name=name, **changes), shipped.files, key)
        return path

    return make


@pytest.fixture
def config() -> Config:
    return load_config(
        overrides=["bus.interface=virtual", f"bus.channel=flash-{os.getpid()}-{next(NUMBERS)}"],
    )


@pytest.fixture
def key_file(tmp_path: Path) -> Path:
    write_key(tmp_path / "access.key", SECRET)
    return tmp_path / "access.key"


@pytest.fixture
def ecu(tmp_path: Path, config: Config, releases: Callable[..., Path]) -> Iterator[Any]:
    provision(tmp_path / "ecu", releases("first"), config)
    with powered(tmp_path / "ecu", config) as made:
        yield made[0]


@pytest.fixture
def flash(cli: Callable[..., Any], config: Config, key_file: Path) -> Callable[..., Any]:
    def call(release: Path, *options: object, access: Path = key_file) -> Any:
        return cli("flash", release, "--bus", f"virtual:{config.bus.channel}", "--access", access, *options)

    return call


@pytest.mark.slow
def test_a_release_is_flashed_and_then_left_alone(
    ecu: Any, flash: Callable[..., Any], releases: Callable[..., Path], tmp_path: Path
) -> None:
    before = {path: path.read_bytes() for path in (tmp_path / "ecu").iterdir()}
    outcome = flash(releases("second"), "--dry-run")
    assert outcome.code == 0
    for words in ("nothing stands against it", "20 ms", "confirmed first"):
        assert words in outcome.out
    assert {path: path.read_bytes() for path in (tmp_path / "ecu").iterdir()} == before
    outcome = flash(releases("second"))
    assert outcome.err == ""
    assert outcome.code == 0
    assert "runs first" in outcome.out
    assert "second runs, and is confirmed; " in outcome.out
    assert ecu.boot.bundle.manifest.name == "second"
    again = flash(releases("second"))
    assert again.code == 0
    assert "second runs already, and is confirmed: nothing was done" in again.out


@pytest.mark.slow
def test_a_release_on_trial_is_confirmed_by_a_second_call(
    ecu: Any, flash: Callable[..., Any], releases: Callable[..., Path]
) -> None:
    outcome = flash(releases("second"), "--no-confirm")
    assert outcome.code == 0
    assert "second runs on trial, 2 boots left" in outcome.out
    assert "first" not in flash(releases("second")).out.split("runs, and is confirmed")[-1]
    assert ecu.store.state.on_trial is None


@pytest.mark.slow
def test_what_the_ecu_refuses_or_would_refuse(
    ecu: Any, flash: Callable[..., Any], releases: Callable[..., Path], tmp_path: Path
) -> None:
    stranger = Ed25519PrivateKey.from_private_bytes(b"else" * 8)
    for name, changes, words in (
        ("foreign", {"key": stranger}, "signed by a key that this ECU does not know; it keeps the one it has"),
        ("unsigned", {"key": None}, "is not signed"),
        ("old", {"security_version": 0}, "has security version 0, the ECU takes 1 or greater"),
        ("other", {"hardware": "other"}, "is for hardware other, the ECU is bench"),
    ):
        outcome = flash(releases(name, **changes))
        assert (outcome.code, outcome.err.count("\n")) == (6, 1), name
        assert words in outcome.err
        assert name == "foreign" or "nothing was written" in outcome.err
    write_key(tmp_path / "wrong.key", bytes(16 * [7]))
    outcome = flash(releases("second"), access=tmp_path / "wrong.key")
    assert (outcome.code, "name that with --access" in outcome.err) == (4, True)
    assert ecu.boot.bundle.manifest.name == "first"
