"""The tester's steps against the real server, programming services and store, in virtual time."""

import pytest

from can_bridge.flashing.verdicts import Verdict
from can_bridge.tester.messages import ImageRefusedError
from can_bridge.tester.sequence import End, Flashed
from can_bridge.uds.services import Service
from tests.can_bridge.flashing.plain_backing import PlainBacking
from tests.can_bridge.flashing.releases import SECOND, STRANGER, image, provisioned
from tests.can_bridge.flashing.store_ecu import StoreEcu
from tests.can_bridge.tester.line import Line, flash_over


class Vehicle:
    """A store with the release `one` in it, and a line to it.

    Args:
        cut_at: number of the write, from 0, in which the power is lost.
        seed: of what such a write still does.
    """

    def __init__(self, *, cut_at: int | None = None, seed: int = 0) -> None:
        self._cut_at, self._seed = cut_at, seed
        self.writes = 0
        self._backing = provisioned()
        self._backing.calls = 0
        self.ecu = StoreEcu(self._power_on)
        self.line = Line(self.ecu)

    @property
    def runs(self) -> str:
        assert self.ecu.boot.bundle is not None
        return self.ecu.boot.bundle.manifest.name

    def flash(self, raw: bytes) -> Flashed:
        flashed = flash_over(self.line, raw)
        self.writes += self._backing.calls
        return flashed

    def _power_on(self) -> PlainBacking:
        self.writes += self._backing.calls
        is_cut = hasattr(self, "line") and self.line.cuts
        left = None if self._cut_at is None or is_cut else self._cut_at - self.writes
        self._backing = self._backing.after_power_on(cut_at=left, seed=self._seed)
        return self._backing


class Mishap:
    """At the request of a number: it is lost, or its answer, or the ECU's power with it."""

    def __init__(self, vehicle: Vehicle, kind: str, number: int) -> None:
        self._vehicle, self._kind, self._left = vehicle, kind, number

    def __call__(self, _payload: bytes, to_ecu: bool) -> bool:
        is_now = self._left == 0 and to_ecu is (self._kind != "answer")
        if is_now or (to_ecu and self._left > 0):
            self._left -= 1
        if is_now and self._kind == "power":
            self._vehicle.ecu.power_on()
        return is_now


def test_releases_are_flashed_one_after_the_other() -> None:
    vehicle = Vehicle()
    for name in ("two", "three", "two"):
        assert vehicle.flash(image(name)).end is End.CONFIRMED
        assert vehicle.runs == name
    assert vehicle.flash(image("two")).end is End.ALREADY


def test_the_store_refuses_what_the_tester_lets_through() -> None:
    vehicle = Vehicle()
    for raw, verdict in (
        (image("unsigned", key=None), Verdict.UNSIGNED),
        (image("foreign", key=STRANGER), Verdict.UNKNOWN_KEY),
        (image("not listed", key=SECOND), Verdict.UNKNOWN_KEY),
        (image("old", version=0), Verdict.TOO_OLD),
        (b"no image", Verdict.DAMAGED),
    ):
        with pytest.raises(ImageRefusedError) as refusal:
            vehicle.flash(raw)
        assert refusal.value.verdict is verdict
        vehicle.line.time.sleep(1.0)
        assert vehicle.runs == "one"
    assert vehicle.flash(image("two", version=2)).end is End.CONFIRMED
    with pytest.raises(ImageRefusedError, match="older than this ECU allows"):
        vehicle.flash(image("three"))


@pytest.mark.slow
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
        assert vehicle.runs == "two", number


@pytest.mark.slow
def test_a_loss_of_power_in_any_one_write_is_overcome() -> None:
    whole = Vehicle()
    whole.flash(image("two"))
    assert whole.writes > 12
    for number in range(whole.writes):
        for seed in range(2):
            vehicle = Vehicle(cut_at=number, seed=seed)
            assert vehicle.flash(image("two")).end is End.CONFIRMED, (number, seed)
            assert (vehicle.runs, vehicle.line.cuts) == ("two", 1), (number, seed)
