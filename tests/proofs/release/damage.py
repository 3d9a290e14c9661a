"""Damaged bundles and C headers, made from sound ones: what the fuzz feeds to those who read them.

Everything follows from a random generator and what is given, so that a case that is refused wrongly can be made again.
"""

import hashlib
import json
from collections.abc import Callable, Mapping
from random import Random
from typing import Any, Final

from tests.contract.release.resealing import sealed

MANIFEST: Final = "manifest.json"
_NUMBERS: Final = (0, 1, 2, 45, 0xFF, 0x7FFF, 0xFFFF, 0x7FFFFFFF, 0xFFFFFFFE, 0xFFFFFFFF)
_NESTED: Final = tuple("[" * depth + "0" + "]" * depth for depth in (10, 31, 33, 200))
_TEXTS: Final = ("", "x", "\x1b[2J", "\ud800", "[/x]", "a\nb", "../x", "\u202e", "1e999", "2026-W01-1", "y" * 5000)


def bytes_of(rng: Random, sound: bytes) -> bytes:
    """Bits flipped, bytes replaced, numbers overwritten, pieces cut out, doubled and put in, and the end cut off."""
    content = bytearray(sound)
    for _ in range(rng.choice((1, 1, 2, 4, 16))):
        place = rng.randrange(len(content) + 1)
        how = rng.randrange(7)
        if how == 0 and place < len(content):
            content[place] ^= 1 << rng.randrange(8)
        elif how == 1 and place < len(content):
            content[place] = rng.randrange(256)
        elif how == 2:
            size = rng.choice((2, 4, 8))
            content[place : place + size] = (rng.choice(_NUMBERS) & (2 ** (8 * size) - 1)).to_bytes(size, "little")
        elif how == 3:
            del content[place : place + rng.choice((1, 2, 8, 64, 512))]
        elif how == 4:
            content[place:place] = content[place : place + rng.choice((1, 4, 46, 200))]
        elif how == 5:
            content[place:place] = rng.randbytes(rng.choice((1, 3, 22)))
        elif rng.random() < 0.3:
            del content[place:]
        if not content:
            break
    return bytes(content)


def manifest_of(rng: Random, sound: bytes) -> bytes:
    """A manifest with values of other kinds, fields gone and fields added, and the right hash of its own."""
    body = json.loads(sound)
    for _ in range(rng.choice((1, 1, 1, 2, 3))):
        table, key = _anywhere(rng, body)
        if rng.random() < 0.2:
            del table[key]
        elif rng.random() < 0.1 and isinstance(table, dict):
            table[rng.choice(_TEXTS)] = _value(rng, 0)
        else:
            table[key] = _value(rng, 0)
        if not body:
            break
    return sealed(body)


def _anywhere(rng: Random, tree: Any) -> tuple[Any, Any]:
    """A table or list in a tree, and a key of it; tables that have something in them."""
    while True:
        key = rng.choice(list(tree)) if isinstance(tree, dict) else rng.randrange(len(tree))
        inner = tree[key]
        if not (isinstance(inner, dict | list) and inner) or rng.random() < 0.3:
            return tree, key
        tree = inner


def _value(rng: Random, depth: int) -> Any:
    makes: list[Callable[[], Any]] = [
        lambda: None,
        lambda: rng.random() < 0.5,
        lambda: rng.choice((0, -1, 1, 2**31, 2**63, 10**18, 10**400, rng.randrange(-1000, 1000))),
        lambda: rng.choice((0.0, -0.0, 1e-300, 1e308, float("nan"), float("inf"), -float("inf"), rng.gauss(0, 1))),
        lambda: rng.choice(_TEXTS),
        lambda: [_value(rng, depth + 1) for _ in range(rng.randrange(4))] if depth < 4 else [],
        lambda: {rng.choice(_TEXTS): _value(rng, depth + 1) for _ in range(rng.randrange(3))} if depth < 4 else {},
        lambda: json.loads(rng.choice(_NESTED)),
    ]
    return rng.choice(makes)()


def with_controller(files: Mapping[str, bytes], name: str, content: bytes) -> dict[str, bytes]:
    """The bundle with another controller, whose hash and whose manifest's hash are right; unsigned."""
    body = json.loads(files[MANIFEST])
    body["files"][name] = hashlib.sha256(content).hexdigest()
    return {MANIFEST: sealed(body), name: content}
