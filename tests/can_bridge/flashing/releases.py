"""Small releases signed by keys that are made here, and an ECU's store to put them into."""

import hashlib
from dataclasses import replace
from functools import cache
from typing import TYPE_CHECKING, Any, TypeVar

from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey

from can_bridge.flashing import checking
from can_bridge.flashing.backing import Backing, Slot, at_once
from can_bridge.flashing.state import SlotPhase
from can_bridge.flashing.store import Boot, Store
from can_bridge.flashing.verdicts import Verdict
from contract.config.controller import MpcConfig
from contract.config.learning import ModelConfig
from contract.release import bundle, key_list
from contract.release.bundle import pack
from contract.release.checks import CONTROLLER, Bundle
from contract.release.container import image_of
from contract.release.key_list import KeyList
from contract.release.manifest import Manifest
from contract.release.signing import PublicKey, public_key
from contract.shipped import BUNDLE
from tests.can_bridge.flashing.plain_backing import PlainBacking

if TYPE_CHECKING:
    from export.program.controller_program import ControllerProgram

ROOT, RELEASE, SECOND, STRANGER = (Ed25519PrivateKey.from_private_bytes(bytes([number]) * 32) for number in range(4))
HARDWARE = "bench"
BLOCK = 5000
"""Bytes that are sent at once: an image has six such blocks."""

B = TypeVar("B", bound=Backing)


@cache
def small_program() -> "ControllerProgram":
    from examples.random_programs import random_program

    model = ModelConfig(window=4, latent=2, lstm_width=4, dynamics_width=8, decoder_width=4)
    return random_program(0, model=model, mpc=MpcConfig(horizon=4, iterations=2))


@cache
def untrained() -> tuple[Manifest, bytes]:
    """The shipped release's facts around the small program: manifest and graph."""
    from export.to_onnx.control_step import build_controller

    program = small_program()
    sizes = {name: getattr(program, name) for name in ("window", "sensors", "mpc", "scaling")}
    facts = replace(bundle.load(BUNDLE).manifest, sensor_estimator=None, air_speed=None)
    manifest = replace(facts, precision="float32", **sizes)
    return manifest, build_controller(program).SerializeToString()


@cache
def image(name: str = "one", *, key: Ed25519PrivateKey | None = RELEASE, version: int = 1, **changes: Any) -> bytes:
    manifest, graph = untrained()
    facts = replace(manifest, name=name, security_version=version, **changes)
    return image_of(pack(facts, {CONTROLLER: graph}, key))


def keys(version: int = 1, *allowed: Ed25519PrivateKey | PublicKey, revoked: Any = ()) -> bytes:
    """A list signed by the root key; by default of the release key."""
    listed = frozenset(key if isinstance(key, PublicKey) else public_key(key) for key in allowed or (RELEASE,))
    return key_list.encode(KeyList(version=version, keys=listed, revoked=frozenset(map(public_key, revoked))), ROOT)


def fits(bundle: Bundle) -> Verdict:
    """A vehicle of the default control period and operating point."""
    if bundle.manifest.control_period != 0.2:
        return Verdict.WRONG_PERIOD
    return Verdict.GOOD if bundle.manifest.operating_point.speed == 25.0 else Verdict.WRONG_VEHICLE


RULES: dict[str, Any] = {
    "root": public_key(ROOT), "hardware": HARDWARE, "fits": fits, "check": cache(checking.check),
}  # fmt: skip
"""Of an ECU's store. Equal bytes, which recur thousands of times, are checked once."""


def provision(backing: B, first: bytes | None, listed: bytes = keys(), **changes: Any) -> B:
    store_on(backing, **changes).provision(listed, first)
    return backing


def provisioned() -> PlainBacking:
    """A memory with release "one" in it."""
    return provision(PlainBacking(), image())


def store_on(backing: Backing, **changes: Any) -> Store:
    return Store(backing, **{**RULES, **changes})


def booted(backing: Backing) -> tuple[Store, Boot]:
    store = store_on(backing)
    return store, store.boot()


def transfer(store: Store, new: bytes, *, until: int | None = None) -> int:
    """Announce an image and send what is wanted of it, up to a block's end; returns the offset that was wanted."""
    wanted = at_once(store.announce(len(new), hashlib.sha256(new).digest()))
    for at in range(wanted, len(new) if until is None else until, BLOCK):
        store.append(new[at : at + BLOCK])
    return wanted


def flash(store: Store, new: bytes) -> Verdict:
    transfer(store, new)
    verdict = at_once(store.finish())
    if verdict == Verdict.GOOD:
        store.activate()
    return verdict


def phases(store: Store) -> list[SlotPhase]:
    return [slot.phase for slot in store.state.slots]


def name_of(boot: Boot) -> str | None:
    return None if boot.bundle is None else boot.bundle.name


def digest_of(boot: Boot) -> str:
    assert boot.bundle is not None
    return boot.bundle.digest


def updated(*images: bytes) -> PlainBacking:
    """An ECU on which release "one" and then all these were confirmed."""
    backing = provisioned()
    for new in images:
        assert flash(booted(backing)[0], new) == Verdict.GOOD
        backing = backing.after_power_on()
        booted(backing)[0].confirm()
        backing = backing.after_power_on()
    return backing


def damage(backing: PlainBacking, slot: Slot, at: int = 9_000) -> None:
    content = backing.slots[slot]
    assert content is not None
    content[at] ^= 1
