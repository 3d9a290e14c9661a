"""Images that were altered, judged by both stores: C under the sanitisers for addresses and undefined behaviour."""

import hashlib
import struct
import subprocess
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from random import Random
from typing import Final

from can_bridge.flashing import checking
from can_bridge.flashing.verdicts import Verdict
from contract.release import key_list
from contract.release.signing import public_key
from tests.can_bridge.flashing.releases import RELEASE, ROOT, SECOND, STRANGER, keys
from tests.proofs.loader_in_c.store_library import (
    GOOD,
    HARDWARE,
    LAYOUT,
    LONG,
    ONE,
    SLOT_BYTES,
    WRONG,
    opens,
    resigned,
    rules,
)  # fmt: skip

SANITISED: Final = ("-O1", "-DTWIN_FUZZ", "-fsanitize=address,undefined", "-fno-sanitize-recover=all")
LIST: Final = keys(1, RELEASE, revoked=(SECOND,))
_BASES: Final = (*GOOD.values(), *WRONG.values())
_EDGES: Final = (0, 8, 12, 16, 48, 80, 112, 144, 148, 156, 180, 188, 192, 256, 320, 416, 448, 480, 511)
_OUT_OF_RANGE: Final = 0x82


def images(seed: int, count: int) -> Iterator[bytes]:
    """Images in order, damaged, cut, joined, or altered and signed again."""
    random = Random(seed)
    for _ in range(count):
        found = bytearray(random.choice(_BASES if random.random() < 0.95 else (LONG,)))
        kind = random.randrange(6)
        if kind == 0:
            for _ in range(random.choice((1, 1, 2, 9))):
                found[random.randrange(len(found))] ^= 1 << random.randrange(8)
        elif kind == 1:
            found = found[: random.randrange(len(found) + 1)]
        elif kind == 2:
            found += random.randbytes(random.choice((1, 31, 700, SLOT_BYTES)))
        elif kind == 3:
            at = random.choice(_EDGES)
            found = found[:at] + bytearray(random.choice(_BASES))[at:]
        elif len(found) >= 512:
            at = random.choice(_EDGES[:-3]) + random.choice((0, 0, 1, 3))
            value = random.choice((b"\0", b"\xff", b"A", random.randbytes(4), random.randbytes(40)))
            key = random.choice((RELEASE, RELEASE, RELEASE, SECOND, STRANGER))
            if random.random() < 0.3:
                found[16:48] = hashlib.sha256(found[512:]).digest()
            found = bytearray(resigned(bytes(found), at, value[: 416 - at], key))
        yield bytes(found)


def fuzz(program: Path, seed: int, count: int) -> tuple[Counter[str], list[str]]:
    """How many images have each verdict, and the first of those that both judge differently. Raises RuntimeError if a
    sanitiser ended the program."""
    made = list(images(seed, count))
    head = rules(ONE) + struct.pack(">I", len(LIST)) + LIST
    sent = head + b"".join(struct.pack(">I", len(one)) + hashlib.sha256(one).digest() + one for one in made)
    done = subprocess.run([program], input=sent, capture_output=True, check=False)
    if done.returncode or len(done.stdout) != count:
        raise RuntimeError(
            f"ended with status {done.returncode} behind {len(done.stdout)} images: {done.stderr[:500]!r}"
        )
    given = checking.Rules(
        keys=key_list.decode(LIST, public_key(ROOT)),
        hardware=HARDWARE,
        fits=checking.fits_as(ONE),
        least_security_version=1,
    )
    counts, different = Counter[str](), list[str]()
    for one, in_c in zip(made, done.stdout, strict=True):
        is_judged = 0 < len(one) <= SLOT_BYTES
        verdict = checking.judge_image(one, given, layout=LAYOUT, opens=opens)[0] if is_judged else _OUT_OF_RANGE
        counts[Verdict(verdict).name if is_judged else "refused"] += 1
        if verdict != in_c:
            different.append(f"{verdict} in Python, {in_c} in C: {one[:512].hex()}")
    return counts, different
