"""Hostile requests to the node in C, in a program that sanitisers watch; its requests are those of random testers."""

import hashlib
import subprocess
from pathlib import Path
from typing import Final

from tests.can_bridge.flashing.releases import keys
from tests.can_bridge.flashing.store_ecu import SECRET
from tests.proofs.loader_in_c.node_library import GEOMETRY
from tests.proofs.loader_in_c.node_program import requests_of
from tests.proofs.loader_in_c.node_twin import World, may_run, rules_of

SANITISED: Final = ("-O1", *GEOMETRY, "-fsanitize=address,undefined", "-fno-sanitize-recover=all", "-g1")
VIOLATIONS: Final = (
    *("stuck", "unlocked_without_key", "activated_unsigned"),
    *("releases_lost", "went_back", "wrong_answers"),
)
REACHED: Final = ("trials", "positive", "pending", "tool_unlocked", "tool_packets")
"""Counts that must not be 0, since the program would otherwise show little."""


def corpus(of: World, file: Path, seeds: range) -> None:
    """What the program reads: a vehicle, its production, and the requests of testers."""
    good = b"".join(hashlib.sha256(image).digest() for image in of.pool.images.values() if may_run(of, image))
    parts = [rules_of(of), SECRET, keys(), of.pool.images["one"], good, *requests_of(of, seeds)]
    file.write_bytes(b"".join(len(part).to_bytes(4, "little") + part for part in parts))


def fuzz(executable: Path, file: Path, seed: int, requests: int) -> dict[str, int]:
    """What the program counted. Raises RuntimeError with a sanitiser's report."""
    command = [str(executable), str(file), str(seed), str(requests)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    if done.returncode != 0:
        raise RuntimeError(f"node_fuzz ended with {done.returncode}: {done.stderr[:2000]}")
    return {name: int(count) for name, count in (line.split() for line in done.stdout.splitlines())}
