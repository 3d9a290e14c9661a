"""The office's side of a fleet: a TUF repository of release bundles, in a folder that any web server can serve.

    python examples/fleet/repository.py create repo keys
    python examples/fleet/repository.py publish repo keys contract/release/shipped
    python examples/fleet/repository.py roll-out repo keys truck-wake-16 10
    python examples/fleet/repository.py renew repo keys

As in Uptane, two roles together decide which bundle a vehicle gets. The role `releases` lists the bundles. Its key, and
the key that signs bundles, stay offline. The role `rollout` states which bundle each hundredth of the fleet runs. Its
key is used whenever a share grows. Neither role can do the work of the other role.
"""

import argparse
import json
import shutil
import sys
from collections.abc import Mapping, Sequence
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any, Final, TypeVar

from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey
from rich import print
from securesystemslib.exceptions import StorageError
from securesystemslib.signer import CryptoSigner
from tuf.api.metadata import (
    DelegatedRole,
    Delegations,
    Metadata,
    MetaFile,
    Root,
    Snapshot,
    TargetFile,
    Targets,
    Timestamp,
)
from tuf.api.serialization import DeserializationError

from contract.errors import OutputError, StillwakeError
from contract.release import bundle as bundles
from contract.release import signing
from contract.release.container import image_of, read_files

RELEASES: Final = "releases"
ROLLOUT: Final = "rollout"
BINS: Final = 100
"""Number of parts of the fleet. The SHA-256 of a vehicle's identity determines the vehicle's part (`vehicle.py`)."""
LIFETIME: Final[Mapping[str, timedelta]] = {
    "root": timedelta(days=365),
    "targets": timedelta(days=365),
    RELEASES: timedelta(days=365),
    ROLLOUT: timedelta(days=30),
    "snapshot": timedelta(days=30),
    "timestamp": timedelta(days=2),
}
"""Lifetime of each role's metadata. If a server withholds new metadata, the timestamp expires in the vehicle."""
ROOT_KEYS: Final = ("root-1", "root-2", "root-3")
ROOT_THRESHOLD: Final = 2
T = TypeVar("T", Root, Snapshot, Targets, Timestamp)

_KEYS: Final = (*ROOT_KEYS, *(name for name in LIFETIME if name != "root"))


class Repository:
    """A repository in a folder that a web server serves, with `metadata` and `targets`. The folder `keys` has a
    subfolder, as `stillwake keygen` makes it, for each key that signs the metadata. Keys that a call does not use may
    be missing. Lifetimes begin at the present time, `now`."""

    def __init__(self, folder: Path, keys: Path, now: datetime) -> None:
        self._folder, self._keys, self._now = folder, keys, now

    def create(self) -> None:
        """Create keys and an empty repository."""
        if self._folder.exists() and any(self._folder.iterdir()):
            raise OutputError(f"{self._folder}: is not empty; name a new folder")
        for name in _KEYS:
            signing.write_key_pair(self._keys / name, Ed25519PrivateKey.generate())
        for part in ("metadata", "targets"):
            (self._folder / part).mkdir(parents=True)
        root = Metadata(Root(consistent_snapshot=True))
        for name in ROOT_KEYS:
            root.signed.add_key(self._signer(name).public_key, "root")
        root.signed.roles["root"].threshold = ROOT_THRESHOLD
        for role in ("targets", "snapshot", "timestamp"):
            root.signed.add_key(self._signer(role).public_key, role)
        self._sign("root", root, ROOT_KEYS)
        targets = Metadata(Targets())
        targets.signed.delegations = Delegations(
            keys={},
            roles={
                role: DelegatedRole(name=role, keyids=[], threshold=1, terminating=True, paths=[f"{role}/*"])
                for role in (RELEASES, ROLLOUT)
            },
        )
        for role in (RELEASES, ROLLOUT):
            targets.signed.add_key(self._signer(role).public_key, role)
        snapshot = Metadata(Snapshot())
        for role, metadata in (("targets", targets), (RELEASES, Metadata(Targets())), (ROLLOUT, Metadata(Targets()))):
            self._sign(role, metadata, (role,))
            snapshot.signed.meta[f"{role}.json"] = MetaFile(version=metadata.signed.version)
        self._sign("snapshot", snapshot, ("snapshot",))
        self._tell(Metadata(Timestamp()), snapshot.signed.version)

    def publish(self, bundle: Path) -> str:
        """Add a bundle to the releases and return its name. No vehicle gets the bundle before its roll-out."""
        verified = bundles.load(bundle)
        manifest = verified.manifest
        if verified.signer is None:
            raise StillwakeError(f"bundle {bundle}: is not signed; no ECU would accept it")
        if set(manifest.name) & set("/\\?#%"):
            raise StillwakeError(f"release {manifest.name}: no vehicle can fetch a name that contains / \\ ? # or %")
        releases = self._read(RELEASES, Targets)
        place = f"{RELEASES}/{manifest.name}"
        if place in releases.signed.targets:
            raise OutputError(f"{place}: is published already; give the release another name")
        target = self._store(place, image_of(read_files(bundle)))
        target.unrecognized_fields["custom"] = {
            "digest": verified.digest,
            "hardware": manifest.hardware,
            "security_version": manifest.security_version,
            "signer": verified.signer.fingerprint,
        }
        releases.signed.targets[place] = target
        self._change(RELEASES, releases)
        return manifest.name

    def roll_out(self, name: str, percent: int) -> int:
        """Let the first `percent` hundredths of the fleet run a release; other vehicles keep their present releases.
        Return the number of hundredths that must now run the release; earlier calls may have set a greater share."""
        if not 1 <= percent <= BINS:
            raise StillwakeError(f"share of {percent} %: must be in 1..{BINS}")
        place = f"{RELEASES}/{name}"
        if place not in self._read(RELEASES, Targets).signed.targets:
            raise StillwakeError(f"release {name}: is not published here")
        rollout = self._read(ROLLOUT, Targets)
        content = json.dumps({"release": place}).encode()
        for number in range(percent):
            path = f"{ROLLOUT}/{number:02}"
            rollout.signed.targets[path] = target = self._store(path, content)
        self._change(ROLLOUT, rollout)
        return sum(one.hashes == target.hashes for one in rollout.signed.targets.values())

    def renew(self) -> None:
        """Sign the timestamp again, so that it does not expire. Call this once a day."""
        self._tell(self._read("timestamp", Timestamp), self._read("snapshot", Snapshot).signed.version)

    def _store(self, place: str, content: bytes) -> TargetFile:
        target = TargetFile.from_data(place, content, ["sha256"])
        path = self._folder / "targets" / Path(place).parent / f"{target.hashes['sha256']}.{Path(place).name}"
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(content)
        return target

    def _change(self, role: str, metadata: Metadata[Targets]) -> None:
        """Sign a delegated role's metadata, and record the new version in the snapshot and the timestamp."""
        self._sign(role, metadata, (role,))
        snapshot = self._read("snapshot", Snapshot)
        snapshot.signed.meta[f"{role}.json"] = MetaFile(version=metadata.signed.version)
        self._sign("snapshot", snapshot, ("snapshot",))
        self._tell(self._read("timestamp", Timestamp), snapshot.signed.version)

    def _tell(self, timestamp: Metadata[Timestamp], snapshot_version: int) -> None:
        timestamp.signed.snapshot_meta = MetaFile(version=snapshot_version)
        self._sign("timestamp", timestamp, ("timestamp",))

    def _sign(self, role: str, metadata: Metadata[Any], keys: Sequence[str]) -> None:
        """Sign the next version of a role's metadata, and write the file completely or not at all."""
        place = self._folder / "metadata"
        if (place / f"{role}.json").exists():
            metadata.signed.version += 1
        metadata.signed.expires = (self._now + LIFETIME[role]).replace(microsecond=0)
        metadata.signatures.clear()
        for key in keys:
            metadata.sign(self._signer(key), append=True)
        part = place / f"{role}.part"
        metadata.to_file(str(part))
        if role != "timestamp":
            shutil.copyfile(part, place / f"{metadata.signed.version}.{role}.json")
        # This program reads the file without a version in its name; vehicles do this only for the timestamp.
        part.replace(place / f"{role}.json")

    def _read(self, role: str, kind: type[T]) -> Metadata[T]:
        path = self._folder / "metadata" / f"{role}.json"
        try:
            found: Metadata[T] = Metadata.from_file(str(path))
        except (StorageError, DeserializationError) as error:
            raise StillwakeError(f"{path}: cannot be read as metadata; use `create` to make a repository") from error
        if not isinstance(found.signed, kind):
            raise StillwakeError(f"{path}: is metadata of another role")
        return found

    def _signer(self, key: str) -> CryptoSigner:
        return CryptoSigner(signing.read_private_key(self._keys / key / signing.PRIVATE_KEY))


def main(arguments: Sequence[str]) -> None:
    """Execute the command that the arguments name."""
    parser = argparse.ArgumentParser(description="A TUF repository of release bundles.")
    calls = parser.add_subparsers(dest="call", required=True)
    for call, words in (
        ("create", "create keys and an empty repository"),
        ("publish", "add a bundle to the releases"),
        ("roll-out", "let a share of the fleet run a release"),
        ("renew", "sign the timestamp again, once a day"),
    ):
        one = calls.add_parser(call, help=words)
        one.add_argument("repository", type=Path)
        one.add_argument("keys", type=Path)
        if call == "publish":
            one.add_argument("bundle", type=Path)
        if call == "roll-out":
            one.add_argument("release")
            one.add_argument("percent", type=int)
    given = parser.parse_args(arguments)
    repository = Repository(given.repository, given.keys, datetime.now(UTC))
    if given.call == "create":
        repository.create()
        print(f"made {given.repository}; give every vehicle its metadata/1.root.json, and keep {given.keys} secret")
    elif given.call == "publish":
        print(f"published {repository.publish(given.bundle)}; no vehicle gets it yet")
    elif given.call == "roll-out":
        share = repository.roll_out(given.release, given.percent)
        print(f"{share} % of the fleet must now run {given.release}")
    else:
        repository.renew()


if __name__ == "__main__":
    try:
        main(sys.argv[1:])
    except (StillwakeError, OSError) as error:
        sys.exit(f"error: {error}")
