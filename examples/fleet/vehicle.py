"""The vehicle's side of a fleet: it fetches the release that the vehicle must run, and checks the release.

    python examples/fleet/vehicle.py https://fleet.example/ state --root 1.root.json --vehicle WDB123 --to new
    stillwake flash new --bus socketcan:can0 --access access.key

This program runs on a computer in the vehicle or in a workshop. The ECU does not rely on these checks, but itself
checks the bundle's signature, hardware and security version. Instead of the URL, the path of a folder can be given.

The folder `state` contains the latest metadata. It must survive a restart, because older metadata is refused.
"""

import argparse
import hashlib
import json
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Final
from urllib.parse import unquote, urlsplit

from rich import print
from tuf.api.exceptions import DownloadError, DownloadHTTPError, RepositoryError
from tuf.ngclient.fetcher import FetcherInterface
from tuf.ngclient.updater import Updater

from contract.atomic import write_files
from contract.errors import StillwakeError
from contract.release.bundle import check_replaceable
from contract.release.checks import Bundle, read_checked
from contract.release.container import files_of

BINS: Final = 100
_CHUNK: Final = 2**16
_NOT_FOUND: Final = 404


class FolderFetcher(FetcherInterface):
    """A fetcher that reads `file:` URLs."""

    def _fetch(self, url: str) -> Iterator[bytes]:
        path = Path(unquote(urlsplit(url).path))
        if not path.is_file():
            raise DownloadHTTPError(f"{path}: does not exist", _NOT_FOUND)
        with path.open("rb") as file:
            while chunk := file.read(_CHUNK):
                yield chunk


def bin_of(vehicle: str) -> int:
    """Return the index of the vehicle's part of the fleet. It never changes, so a growing share loses no vehicle."""
    return int.from_bytes(hashlib.sha256(vehicle.encode()).digest()[:8], "big") * BINS >> 64


def fetch(repository: str, state: Path, root: bytes, *, vehicle: str, hardware: str, to: Path) -> Bundle | None:
    """Fetch the release that a vehicle must run from a repository (URL or path of a folder), check it, write it into
    the directory `to` as a bundle, and return it; None if nothing is rolled out to this vehicle. `state` is the folder
    for the latest metadata, which the first call creates; `root` is the root metadata that the vehicle got at
    production. Raises StillwakeError if the repository cannot be read or is not valid, or the release is not for this
    vehicle."""
    try:
        updater = _updater(repository, state, root)
        updater.refresh()
        assignment = updater.get_targetinfo(f"rollout/{bin_of(vehicle):02}")
        if assignment is None:
            return None
        place = _release_in(Path(updater.download_target(assignment)).read_bytes())
        release = updater.get_targetinfo(place) if place.startswith("releases/") else None
        if release is None:
            raise StillwakeError(f"{place}: is rolled out, but was not published by the role `releases`")
        custom = release.unrecognized_fields.get("custom")
        custom = custom if isinstance(custom, dict) else {}
        if custom.get("hardware") not in (None, hardware):
            raise StillwakeError(f"{place}: is for hardware {custom['hardware']}, this vehicle has {hardware}")
        image = Path(updater.download_target(release, str(state / "downloads" / "release"))).read_bytes()
    except (RepositoryError, DownloadError, ValueError) as error:
        raise StillwakeError(f"repository {repository}: {type(error).__name__}: {error}") from error
    files = files_of(image)
    bundle = read_checked(to, files)
    if bundle.digest != custom.get("digest"):
        raise StillwakeError(f"{place}: contains bundle {bundle.digest[:12]}, which is not the published bundle")
    check_replaceable(to)
    write_files(to, files)
    return bundle


def _updater(repository: str, state: Path, root: bytes) -> Updater:
    is_url = "://" in repository
    base = (repository if is_url else Path(repository).resolve().as_uri()).rstrip("/")
    downloads = state / "downloads"
    downloads.mkdir(parents=True, exist_ok=True)
    fetcher = None if is_url else FolderFetcher()
    return Updater(str(state), f"{base}/metadata/", str(downloads), f"{base}/targets/", fetcher=fetcher, bootstrap=root)


def _release_in(assignment: bytes) -> str:
    try:
        return str(json.loads(assignment)["release"])
    except (ValueError, KeyError, TypeError) as error:
        raise StillwakeError(f"assignment {assignment[:80]!r}: names no release") from error


def main(arguments: Sequence[str]) -> None:
    """Fetch the vehicle's release, and print its name."""
    parser = argparse.ArgumentParser(description="Fetch the release that a vehicle must run.")
    parser.add_argument("repository", help="URL or folder")
    parser.add_argument("state", type=Path, help="folder that must survive a restart")
    parser.add_argument("--root", type=Path, required=True, help="root metadata from production")
    parser.add_argument("--vehicle", required=True, help="identity of the vehicle")
    parser.add_argument("--hardware", default="generic", help="hardware of the ECU")
    parser.add_argument("--to", type=Path, required=True, help="directory to write the bundle to")
    args = parser.parse_args(arguments)
    root = args.root.read_bytes()
    bundle = fetch(args.repository, args.state, root, vehicle=args.vehicle, hardware=args.hardware, to=args.to)
    if bundle is None:
        print(f"nothing is rolled out to {args.vehicle}")
    else:
        print(f"{args.vehicle} must run {bundle.manifest.name}: wrote {args.to}")


if __name__ == "__main__":
    try:
        main(sys.argv[1:])
    except (StillwakeError, OSError) as error:
        sys.exit(f"error: {error}")
