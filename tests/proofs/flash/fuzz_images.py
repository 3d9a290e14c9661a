"""Images and key lists for the requests of `benchmarks.flash.fuzz`: sound ones, and every kind that must be refused."""

import hashlib
import tempfile
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import Final

from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey

from benchmarks.release.bundle_fuzz import Sound
from contract.release import bundle, key_list, signing
from contract.release.bundle import CONTROLLER
from contract.release.image import image_of
from contract.release.key_list import KeyList
from contract.release.signing import PublicKey

HARDWARE: Final = "bench"
ROOT: Final = Ed25519PrivateKey.from_private_bytes(b"\x01" * 32)
FIRST: Final = Ed25519PrivateKey.from_private_bytes(b"\x02" * 32)
"""Signs what is there from production on; never revoked."""
SECOND: Final = Ed25519PrivateKey.from_private_bytes(b"\x03" * 32)
"""Allowed by some lists, revoked by others."""
STRANGER: Final = Ed25519PrivateKey.from_private_bytes(b"\x04" * 32)


@dataclass(frozen=True, kw_only=True)
class Origin:
    """Of an image that may run: by whom, and how old."""

    signer: PublicKey
    security_version: int


@dataclass(frozen=True, kw_only=True)
class Pool:
    """What testers send.

    Attributes:
        images: all of them, by name; `first` is the one from production.
        origins: of those that may run as long as their signer may sign, by the SHA-256 of the image.
        key_lists: signed by the root key, the one from production first.
        foreign_lists: not signed by it, or damaged.
    """

    images: Mapping[str, bytes]
    origins: Mapping[bytes, Origin]
    key_lists: tuple[bytes, ...]
    foreign_lists: tuple[bytes, ...]


@cache
def pool() -> Pool:
    """The same in every process."""
    with tempfile.TemporaryDirectory() as folder:
        sound = Sound.make(Path(folder))
    graph = sound.files[CONTROLLER]

    def files(key: Ed25519PrivateKey | None, version: int, name: str, hardware: str | None = None) -> dict[str, bytes]:
        manifest = replace(sound.manifest, name=name, security_version=version, hardware=hardware)
        return bundle.pack(manifest, {CONTROLLER: graph}, key)

    good = {
        "first": (FIRST, 1),
        "newer": (FIRST, 2),
        "newest": (FIRST, 3),
        "second": (SECOND, 2),
    }
    images = {name: image_of(files(key, version, name)) for name, (key, version) in good.items()}
    origins = {
        hashlib.sha256(images[name]).digest(): Origin(signer=signing.public_key(key), security_version=version)
        for name, (key, version) in good.items()
    }
    signed = files(FIRST, 2, "signed")
    damaged = bytearray(graph)
    damaged[len(damaged) // 2] ^= 1
    images |= {
        "old": image_of(files(FIRST, 0, "old")),
        "unsigned": image_of(files(None, 2, "unsigned")),
        "stranger's": image_of(files(STRANGER, 2, "stranger's")),
        "other hardware's": image_of(files(FIRST, 2, "other", hardware="other")),
        "with another's signature": image_of({**signed, bundle.SIGNATURE: files(FIRST, 3, "x")[bundle.SIGNATURE]}),
        "with another graph": image_of({**signed, CONTROLLER: bytes(damaged)}),
        "no image": bytes(5000),
    }
    first, second, stranger = (signing.public_key(key) for key in (FIRST, SECOND, STRANGER))
    lists = [
        KeyList(version=1, keys=frozenset({first})),
        KeyList(version=2, keys=frozenset({first, second})),
        KeyList(version=3, keys=frozenset({first}), revoked=frozenset({second})),
        KeyList(version=4, keys=frozenset({first, second})),
    ]
    root_signed = tuple(key_list.encode(one, ROOT) for one in lists)
    evil = KeyList(version=9, keys=frozenset({first, stranger}))
    foreign = (
        key_list.encode(evil, STRANGER),
        key_list.encode(evil, FIRST),
        root_signed[1][:-1],
        root_signed[3] + b"\n",
    )
    return Pool(images=images, origins=origins, key_lists=root_signed, foreign_lists=foreign)
