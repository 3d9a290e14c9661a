"""The tester's steps against the real server, programming services and store, in virtual time."""

from collections.abc import Callable
from functools import cache

import pytest
from udsoncan.client import Client

from can_bridge.flashing import report
from can_bridge.flashing.store import Store
from can_bridge.flashing.verdicts import Verdict
from can_bridge.tester.messages import ImageRefusedError
from can_bridge.tester.sequence import End, Flashed, flash
from can_bridge.uds.access_key import AccessKey
from can_bridge.uds.diagnostics import Diagnostics, Long
from can_bridge.uds.programming import Programming
from can_bridge.uds.refused import Refused
from can_bridge.uds.services import Did, Nrc, Service
from contract.release.onnx_graph import check_graph
from contract.release.signing import public_key
from tests.can_bridge.flashing.plain_backing import PlainBacking
from tests.can_bridge.flashing.releases import RELEASE, ROOT, SECOND, STRANGER, fits, image, keys
from tests.can_bridge.tester.conftest import played
from tests.can_bridge.tester.played_ecu import SECRET, Line, VirtualTime

FACTS = played().dids
GRAPH_CHECKED = cache(check_graph)


@pytest.fixture(autouse=True)
def _graphs_checked_once(monkeypatch: pytest.MonkeyPatch) -> None:
    """Every boot checks all of an image, of which this takes longest; here the graph is always the same."""
    monkeypatch.setattr("contract.release.bundle.check_graph", GRAPH_CHECKED)


class Rest:
    """What the store has no part in."""

    def __init__(self, on_reset: Callable[[], None]) -> None:
        self.reset = on_reset

    def read(self, did: Did) -> bytes:
        if did not in FACTS:
            raise Refused(Nrc.OUT_OF_RANGE)
        return FACTS[did]

    def write(self, did: Did, value: bytes) -> Long[None]:
        raise Refused(Nrc.OUT_OF_RANGE)

    def self_test(self) -> Long[bytes]:
        yield
        return b""


class Vehicle:
    """A store with the release `one` in it, and a line to it.

    Args:
        cut_at: number of the write, from 0, in which the power is lost.
        seed: of what such a write still does.
    """

    def __init__(self, *, cut_at: int | None = None, seed: int = 0) -> None:
        self.time = VirtualTime()
        self._cut_at, self._seed = cut_at, seed
        self._writes_before = 0
        self._backing = PlainBacking()
        Store.provision(
            self._backing,
            root=public_key(ROOT),
            keys=keys(1, RELEASE, revoked=(SECOND,)),
            image=image(),
            hardware="bench",
            fits=fits,
        )
        self._backing.calls = 0
        self.line = Line(played(), self.time, self._made)

    @property
    def writes(self) -> int:
        """So far."""
        return self._writes_before + self._backing.calls

    @property
    def runs(self) -> str:
        boot = self.store.last_boot
        assert boot is not None
        assert boot.bundle is not None
        return boot.bundle.manifest.name

    def flash(self, raw: bytes) -> Flashed:
        time = self.time
        return flash(Client(self.line), raw, key=AccessKey(SECRET).answer, clock=time.clock, sleep=time.sleep)

    def _cuts(self) -> int:
        return self.line.cuts if hasattr(self, "line") else 0

    def _made(self, on_reset: Callable[[], None]) -> Diagnostics:
        self._writes_before = self.writes
        left = None if self._cut_at is None or self._cuts() else self._cut_at - self._writes_before
        self._backing = self._backing.after_power_on(cut_at=left, seed=self._seed)
        self.store = Store(self._backing, root=public_key(ROOT), hardware="bench", fits=fits)
        self.store.boot()
        return Programming(
            self.store,
            Rest(on_reset),
            refusal=lambda: None,
            report=lambda store: report.encode(report.report_of(store)),
        )


class Mishap:
    """At the request of a number: it is lost, or its answer, or the ECU's power with it."""

    def __init__(self, vehicle: Vehicle, kind: str, number: int) -> None:
        self._vehicle, self._kind, self._left = vehicle, kind, number

    def __call__(self, _payload: bytes, to_ecu: bool) -> bool:
        is_now = self._left == 0 and to_ecu is (self._kind != "answer")
        if is_now or (to_ecu and self._left > 0):
            self._left -= 1
        if is_now and self._kind == "power":
            self._vehicle.line.power_on()
        return is_now


def test_releases_are_flashed_one_after_the_other() -> None:
    vehicle = Vehicle()
    for name in ("two", "three", "two"):
        assert vehicle.flash(image(name)).end is End.CONFIRMED
        assert vehicle.runs == name
    assert vehicle.flash(image("two")).end is End.ALREADY


@pytest.mark.parametrize(
    ("raw", "verdict"),
    [
        (image("unsigned", key=None), Verdict.UNSIGNED),
        (image("foreign", key=STRANGER), Verdict.UNKNOWN_KEY),
        (image("former", key=SECOND), Verdict.REVOKED_KEY),
        (image("old", version=0), Verdict.TOO_OLD),
        (image("slow", control_period=0.4), Verdict.WRONG_PERIOD),
        (image("other", hardware="other"), Verdict.WRONG_HARDWARE),
        (image("cut")[:-1], Verdict.DAMAGED),
        (b"no image", Verdict.DAMAGED),
    ],
)
def test_the_store_refuses_what_the_tester_lets_through(raw: bytes, verdict: Verdict) -> None:
    vehicle = Vehicle()
    with pytest.raises(ImageRefusedError) as caught:
        vehicle.flash(raw)
    assert caught.value.verdict is verdict
    vehicle.time.sleep(1.0)
    assert vehicle.runs == "one"
    assert vehicle.flash(image("two")).end is End.CONFIRMED


def test_an_older_release_stays_out_once_a_newer_one_is_confirmed() -> None:
    vehicle = Vehicle()
    assert vehicle.flash(image("newer", version=2)).end is End.CONFIRMED
    with pytest.raises(ImageRefusedError, match="older than this ECU allows"):
        vehicle.flash(image("two"))


@pytest.mark.parametrize("kind", ["request", "answer", "power"])
def test_a_mishap_at_any_one_request_is_overcome(kind: str) -> None:
    """The tester brings it to its end by itself."""
    whole = Vehicle()
    whole.flash(image("two"))
    blocks = [number for number, request in enumerate(whole.line.heard) if request[0] == Service.TRANSFER]
    for number in range(len(whole.line.heard)):
        # Blocks in the middle are all alike.
        if number in blocks[2:-2]:
            continue
        vehicle = Vehicle()
        vehicle.line.lose = Mishap(vehicle, kind, number)
        assert vehicle.flash(image("two")).end is End.CONFIRMED, number
        assert vehicle.runs == "two"


def test_a_loss_of_power_in_any_one_write_is_overcome() -> None:
    whole = Vehicle()
    whole.flash(image("two"))
    assert whole.writes > 30
    for number in range(whole.writes):
        vehicle = Vehicle(cut_at=number, seed=number)
        assert vehicle.flash(image("two")).end is End.CONFIRMED, number
        assert vehicle.runs == "two"
        assert vehicle.line.cuts == 1
