"""The example of a fleet: who gets which release, and that no server, network or single key can change it.

The other side is tuf's own client, as a vehicle runs it.
"""

import json
import runpy
import shutil
from datetime import UTC, datetime, timedelta
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey

from contract.errors import StillwakeError
from contract.release import bundle as bundles
from tests.conftest import SIGNING_KEY

FLEET = Path(__file__).parents[1] / "examples" / "fleet"
REPOSITORY, VEHICLE = (SimpleNamespace(**runpy.run_path(str(FLEET / f"{who}.py"))) for who in ("repository", "vehicle"))
NOW = datetime.now(UTC)
FIRST, LAST = "A211", "A42"  # identities in the first and the last hundredth


class Office:
    """A repository of two releases of which the first is rolled out to all."""

    def __init__(self, place: Path) -> None:
        self.folder, self.keys, self.bundle = place / "repo", place / "keys", place / "next"

    def at(self, now: datetime) -> Any:
        return REPOSITORY.Repository(self.folder, self.keys, now)

    def asked_by(self, state: Path, vehicle: str = FIRST, hardware: str = "h7") -> str | None:
        """Name of the release that a vehicle gets."""
        to = state / "new"
        root = (self.folder / "metadata" / "1.root.json").read_bytes()
        found = VEHICLE.fetch(str(self.folder), state, root, vehicle=vehicle, hardware=hardware, to=to)
        assert found is None or bundles.load(to).digest == found.digest
        return None if found is None else found.manifest.name

    def newest(self, role: str) -> Path:
        files = (self.folder / "metadata").glob(f"*.{role}.json")
        return max(files, key=lambda path: int(path.name.partition(".")[0]))

    def target(self, place: str) -> Path:
        folder, _, name = place.partition("/")
        return next((self.folder / "targets" / folder).glob(f"*.{name}"))


@pytest.fixture(scope="module")
def made(sound, tmp_path_factory) -> Path:
    made = Office(tmp_path_factory.mktemp("fleet"))
    made.at(NOW).create()
    of_h7: dict[str, Any] = {"security_version": 3, "hardware": "h7"}
    bundles.renew(sound, made.bundle, name="next", created="2026-11-22", key=SIGNING_KEY, **of_h7)
    for bundle in (sound, made.bundle):
        made.at(NOW).publish(bundle)
    made.at(NOW).roll_out("random", 100)
    return made.bundle.parent


@pytest.fixture
def office(made, tmp_path) -> Office:
    return Office(shutil.copytree(made, tmp_path / "office"))


def refused(office: Office, state: Path, *words: str, **asked: Any) -> None:
    with pytest.raises(StillwakeError) as refusal:
        office.asked_by(state, **asked)
    assert all(word in str(refusal.value) for word in words), refusal.value
    assert "\n" not in str(refusal.value)
    assert not (state / "new").exists()


def test_a_share_gets_the_new_release_and_the_others_keep_the_old(office, tmp_path):
    bins = [VEHICLE.bin_of(f"A{number}") for number in range(20_000)]
    # Of 200 vehicles a bin, give or take five standard deviations of a binomial.
    assert all(130 <= bins.count(number) <= 270 for number in range(100))
    vehicles = {vehicle: tmp_path / vehicle for vehicle in (FIRST, LAST)}
    assert {office.asked_by(state, vehicle) for vehicle, state in vehicles.items()} == {"random"}
    # A smaller share takes no release from a vehicle.
    assert [office.at(NOW).roll_out("next", percent) for percent in (10, 50, 5)] == [10, 50, 50]
    assert [office.asked_by(state, vehicle) for vehicle, state in vehicles.items()] == ["next", "random"]
    office.at(NOW).roll_out("next", 100)
    assert {office.asked_by(state, vehicle) for vehicle, state in vehicles.items()} == {"next"}
    # And back, for all: the ECU decides whether it takes it.
    office.at(NOW).roll_out("random", 100)
    assert {office.asked_by(state, vehicle) for vehicle, state in vehicles.items()} == {"random"}


def test_the_lines_of_the_page_do_the_same(sound, tmp_path, capsys):
    repo, keys = tmp_path / "repo", tmp_path / "keys"
    for arguments in (["create"], ["publish", sound], ["roll-out", "random", 100], ["renew"]):
        REPOSITORY.main([arguments[0], str(repo), str(keys), *map(str, arguments[1:])])
    root = repo / "metadata" / "1.root.json"
    to = tmp_path / "new"
    VEHICLE.main([str(repo), str(tmp_path / "s"), "--root", str(root), "--vehicle", "A1", "--to", str(to)])
    assert "A1 must run random" in capsys.readouterr().out
    assert bundles.load(to).manifest.name == "random"


def test_a_name_that_no_vehicle_could_fetch_is_not_published(office, tmp_path):
    for number, name in enumerate(("a/b", "a#b", "a?b", "a%62", "..\\b")):
        bundles.renew(office.bundle, tmp_path / str(number), name=name, created="2026-11-22", key=SIGNING_KEY)
        with pytest.raises(StillwakeError, match="no vehicle can fetch"):
            office.at(NOW).publish(tmp_path / str(number))
    assert office.asked_by(tmp_path / "state") == "random"


def test_what_was_altered_or_is_old_is_not_taken(office, tmp_path):
    def altered(path: Path, content: bytes, *words: str) -> None:
        sound = path.read_bytes()
        path.write_bytes(content)
        refused(office, tmp_path / path.name, *words)
        path.write_bytes(sound)

    bundle = office.target("releases/random")
    content = bytearray(bundle.read_bytes())
    content[len(content) // 2] ^= 1
    altered(bundle, bytes(content), "LengthOrHashMismatchError")
    for role in ("timestamp", "snapshot", "targets", "releases", "rollout"):
        path = office.folder / "metadata" / "timestamp.json" if role == "timestamp" else office.newest(role)
        body = json.loads(path.read_bytes())
        body["signed"]["expires"] = "2099-01-01T00:00:00Z"
        altered(path, json.dumps(body).encode(), "signed by")
    altered(office.target("rollout/00"), json.dumps({"release": "releases/next"}).encode(), "Error")
    office.at(NOW - timedelta(days=3)).renew()
    refused(office, tmp_path / "state", "ExpiredMetadataError", "timestamp")


def test_who_may_roll_out_may_not_publish(office, tmp_path):
    """A stolen key of `rollout` signs a bundle of its own into the releases, and points at it."""
    thief = tmp_path / "thief"
    shutil.copytree(office.keys / "rollout", thief / "releases")
    for role in ("snapshot", "timestamp", "rollout"):
        # The keys that stand on a server together.
        shutil.copytree(office.keys / role, thief / role)
    evil = tmp_path / "evil"
    bundles.renew(office.bundle, evil, name="evil", created="2026-11-22", key=Ed25519PrivateKey.generate())
    stolen = REPOSITORY.Repository(office.folder, thief, NOW)
    stolen.publish(evil)
    stolen.roll_out("evil", 100)
    refused(office, tmp_path / "state", "releases was signed by 0/1 keys")


def test_an_assignment_of_what_was_never_published_is_refused(office, tmp_path):
    repository = office.at(NOW)
    rollout = repository._read("rollout", REPOSITORY.Targets)
    for place in ("releases/evil", "rollout/01"):
        content = json.dumps({"release": place}).encode()
        rollout.signed.targets["rollout/00"] = repository._store("rollout/00", content)
        repository._change("rollout", rollout)
        refused(office, tmp_path / "state", place, "was not published")


def test_what_makes_no_sense_is_refused(office, random_release, tmp_path):
    for (call, *others), message in (
        (["create"], "is not empty"),
        (["publish", str(office.bundle)], "is published already"),
        (["roll-out", "nothing", "10"], "is not published here"),
        (["roll-out", "next", "0"], "must be in 1..100"),
        (["roll-out", "next", "101"], "must be in 1..100"),
    ):
        with pytest.raises(StillwakeError, match=message):
            REPOSITORY.main([call, str(office.folder), str(office.keys), *others])
    with pytest.raises(StillwakeError, match="is not signed"):
        office.at(NOW).publish(random_release)
    office.at(NOW).roll_out("next", 100)
    refused(office, tmp_path / "state", "is for hardware h7, this vehicle has h8", hardware="h8")
