"""Images for flashing, signed by keys that are made here, and an ECU's store to put them into."""

import hashlib
from functools import cache
from typing import Any

from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey

from can_bridge.flashing.backing import Slot, at_once
from can_bridge.flashing.boot import Boot
from can_bridge.flashing.state import Phase
from can_bridge.flashing.store import Store
from can_bridge.flashing.verdicts import Verdict
from contract.release import key_list
from contract.release.bundle import CONTROLLER, Bundle, pack
from contract.release.image import image_of
from contract.release.key_list import KeyList
from contract.release.signing import public_key
from tests.can_bridge.flashing.plain_backing import PlainBacking
from tests.contract.release.test_bundle import GRAPH, manifest

ROOT, RELEASE, SECOND, STRANGER = (Ed25519PrivateKey.from_private_bytes(bytes([number]) * 32) for number in range(4))
HARDWARE = "stillwake-ecu-1"
BLOCK = 16_384


@cache
def image(name: str = "one", *, key: Ed25519PrivateKey | None = RELEASE, version: int = 1, **changes: Any) -> bytes:
    """Of a bundle whose graph is the shipped one."""
    return image_of(pack(manifest(name=name, security_version=version, **changes), {CONTROLLER: GRAPH}, key))


def keys(version: int = 1, *allowed: Ed25519PrivateKey, revoked: tuple[Ed25519PrivateKey, ...] = ()) -> bytes:
    """A list signed by the root key; by default of the release key."""
    listed = KeyList(
        version=version,
        keys=frozenset(map(public_key, allowed or (RELEASE,))),
        revoked=frozenset(map(public_key, revoked)),
    )
    return key_list.encode(listed, ROOT)


def fits(bundle: Bundle) -> Verdict:
    """A vehicle of the default control period and operating point."""
    if bundle.manifest.control_period != 0.2:
        return Verdict.WRONG_PERIOD
    return Verdict.GOOD if bundle.manifest.operating_point.speed == 25.0 else Verdict.WRONG_VEHICLE


def provisioned(first: bytes | None = None, backing: PlainBacking | None = None) -> PlainBacking:
    """A memory as it leaves production."""
    made = PlainBacking() if backing is None else backing
    Store.provision(
        made, root=public_key(ROOT), keys=keys(), image=image() if first is None else first, hardware=HARDWARE,
        fits=fits,
    )  # fmt: skip
    return made


def store_on(backing: PlainBacking) -> Store:
    """Power on."""
    return Store(backing, root=public_key(ROOT), hardware=HARDWARE, fits=fits)


def booted(backing: PlainBacking) -> tuple[Store, Boot]:
    """Power on, and boot."""
    store = store_on(backing)
    return store, store.boot()


def transfer(store: Store, new: bytes, *, until: int | None = None) -> int:
    """Announce an image and send what is wanted of it, up to a block's end; returns the offset that was wanted."""
    wanted = at_once(store.announce(len(new), hashlib.sha256(new).digest()))
    for at in range(wanted, len(new) if until is None else until, BLOCK):
        store.append(new[at : at + BLOCK])
    return wanted


def flash(store: Store, new: bytes) -> Verdict:
    """All of it up to the activation."""
    transfer(store, new)
    verdict = at_once(store.finish())
    if verdict == Verdict.GOOD:
        store.activate()
    return verdict


def phases(store: Store) -> list[Phase]:
    return [slot.phase for slot in store.state.slots]


def name_of(boot: Boot) -> str | None:
    return None if boot.bundle is None else boot.bundle.manifest.name


def digest_of(boot: Boot) -> str:
    assert boot.bundle is not None
    return boot.bundle.digest


def updated(*images: bytes) -> PlainBacking:
    """An ECU on which release "one" and then all these were confirmed."""
    backing = provisioned()
    for new in images:
        store, _ = booted(backing)
        assert flash(store, new) == Verdict.GOOD
        backing = backing.after_power_on()
        store, _ = booted(backing)
        store.confirm()
        backing = backing.after_power_on()
    return backing


def damage(backing: PlainBacking, slot: Slot, at: int = 30_000) -> None:
    content = backing.memory.slots[slot]
    assert content is not None
    content[at] ^= 1
