"""The releases of the proof: the shipped one, renewed under the key of the tests; the second replaces the first."""

import tempfile
from functools import cache
from pathlib import Path

from contract.release import bundle
from contract.release.container import read_files
from contract.release.image import image_of
from contract.shipped import BUNDLE
from tests.can_bridge.flashing.releases import RELEASE

OLD, NEW = 1, 2
"""Security versions of the two releases."""


@cache
def shipped(security_version: int) -> bytes:
    """The image of the release with this security version."""
    with tempfile.TemporaryDirectory() as folder:
        target = Path(folder) / "bundle"
        name = f"bench-{security_version}"
        bundle.renew(
            BUNDLE, target, name=name, created="2026-01-01", key=RELEASE, security_version=security_version
        )  # fmt: skip
        return image_of(read_files(target))
