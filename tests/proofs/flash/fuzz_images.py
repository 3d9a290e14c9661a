"""Images and key lists for hostile requests: sound ones, and every kind that must be refused."""

import hashlib
from functools import cache
from typing import NamedTuple

from contract.release import key_list, signing
from contract.release.checks import CONTROLLER, SIGNATURE
from contract.release.image import image_of
from contract.release.key_list import KeyList
from contract.release.signing import PublicKey
from tests.can_bridge.flashing.releases import RELEASE, SECOND, STRANGER, files, image, keys


class Origin(NamedTuple):
    """Who signed an image that may run, and how old it is."""

    signer: PublicKey
    security_version: int


class Pool(NamedTuple):
    """What testers send.

    Attributes:
        images: all of them, by name; `one` is the one from production.
        origins: of those that may run as long as their signer may sign, by the SHA-256 of the image.
        key_lists: signed by the root key, the one from production first.
        foreign_lists: not signed by it, or damaged.
    """

    images: dict[str, bytes]
    origins: dict[bytes, Origin]
    key_lists: tuple[bytes, ...]
    foreign_lists: tuple[bytes, ...]


@cache
def pool() -> Pool:
    """The same in every process."""
    good = {"one": (RELEASE, 1), "newer": (RELEASE, 2), "newest": (RELEASE, 3), "second": (SECOND, 2)}
    images = {name: image(name, key=key, version=version) for name, (key, version) in good.items()}
    origins = {
        hashlib.sha256(images[name]).digest(): Origin(signer=signing.public_key(key), security_version=version)
        for name, (key, version) in good.items()
    }
    signed = files("signed", version=2)
    damaged = bytearray(signed[CONTROLLER])
    damaged[len(damaged) // 2] ^= 1
    images |= {
        "old": image("old", version=0),
        "unsigned": image("unsigned", version=2, key=None),
        "stranger's": image("stranger's", version=2, key=STRANGER),
        "other hardware's": image("other", version=2, hardware="other"),
        "with another's signature": image_of({**signed, SIGNATURE: files("x", version=3)[SIGNATURE]}),
        "with another graph": image_of({**signed, CONTROLLER: bytes(damaged)}),
        "no image": bytes(5000),
    }
    lists = (keys(1), keys(2, RELEASE, SECOND), keys(3, RELEASE, revoked=(SECOND,)), keys(4, RELEASE, SECOND))
    evil = KeyList(version=9, keys=frozenset(map(signing.public_key, (RELEASE, STRANGER))))
    foreign = (key_list.encode(evil, STRANGER), key_list.encode(evil, RELEASE), lists[1][:-1], lists[3] + b"\n")
    return Pool(images=images, origins=origins, key_lists=lists, foreign_lists=foreign)
