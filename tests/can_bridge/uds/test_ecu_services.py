"""How the store's answers come over the wire, request by request; and what the calibration's identifiers refuse and
store. Hostile requests, and that a self-test comes before a confirmation, are tested in `tests/proofs/loader_in_c`."""

import pytest

from can_bridge.calibration.segment import Page, Segment
from can_bridge.flashing.backing import MediumError, RecordKind
from can_bridge.flashing.state import Level, SlotPhase
from can_bridge.flashing.verdicts import Verdict
from can_bridge.uds.calibration_service import CalibrationService
from can_bridge.uds.services import Did, Nrc, Refused
from tests.can_bridge.calibration.conftest import LIMITS, REFERENCE, changed
from tests.can_bridge.flashing.releases import RELEASE, SECOND, image, keys, name_of, phases, provisioned
from tests.can_bridge.flashing.store_ecu import KEY, FlashingSteps, StoreEcu
from tests.can_bridge.uds.scripted_ecu import MS, refused, talk

NEWER = image("newer", version=2)
LENGTH = f"{len(NEWER):08x}"


class Client(FlashingSteps):
    def __init__(self) -> None:
        self.memory = provisioned()
        self.ecu = StoreEcu(lambda: self.memory)
        self.now_ns = 0

    def ask(self, request: bytes) -> bytes:
        answers = self.ecu.server.request(self.now_ns, request)
        while self.ecu.server.is_busy and not self.ecu.is_reset:
            self.now_ns += MS
            answers += self.ecu.server.tick(self.now_ns)
        return answers[-1]

    def talk(self, text: str) -> None:
        talk(lambda request: [self.ask(request)], text)


@pytest.fixture
def client() -> Client:
    return Client()


def test_a_release_is_flashed_and_confirmed(client):
    assert client.write(NEWER) == Verdict.GOOD
    # Confirmation is for what runs on trial; a tester that missed an answer is answered alike.
    client.talk(2 * "31 01 02 06 > SEQUENCE_ERROR\n31 01 02 05 > 71 01 02 05\n")
    assert phases(client.ecu.store) == [SlotPhase.CONFIRMED, SlotPhase.TRIAL]
    client.talk("11 01 > 51 01")
    assert (client.ecu.is_reset, name_of(client.ecu.power_on())) == (True, "newer")
    client.programming()
    # There is no way back to what is too old now.
    client.talk(
        "31 01 02 04 > 71 01 02 04\n" + 2 * "31 01 02 06 > 71 01 02 06\n" + "31 01 02 07 > CONDITIONS_NOT_CORRECT"
    )
    client.ecu.power_on()
    # A tester whose release was given up must not take the one before for its own.
    client.programming()
    client.talk("31 01 02 06 > SEQUENCE_ERROR")


def test_only_the_bytes_that_are_missing_are_taken(client):
    client.programming()
    client.talk(
        f"""
        31 01 FF 00 00x4 00x32 > OUT_OF_RANGE
        34 00 44 00x4 {LENGTH} > SEQUENCE_ERROR
        31 01 FF 01 > SEQUENCE_ERROR
        """
    )
    client.announce(NEWER)
    client.talk(
        f"""
        34 00 44 00x4 {len(NEWER) - 1:08x} > OUT_OF_RANGE
        34 00 44 00x4 {len(NEWER) + 1:08x} > OUT_OF_RANGE
        34 00 44 {1:08x} {LENGTH} > OUT_OF_RANGE
        34 00 44 FFx4 {LENGTH} > OUT_OF_RANGE
        34 00 44 00x4 {LENGTH} > ok
        36 01 {NEWER[:500].hex()} > ok
        31 01 FF 01 > 71 01 FF 01 {Verdict.INCOMPLETE:02x}
        31 01 02 05 > SEQUENCE_ERROR
        """
    )
    assert client.announce(image("another")) == 0


def test_identifiers_and_key_lists(client):
    client.programming()
    both = keys(2, RELEASE, SECOND).hex()
    client.talk(
        f"""
        22 FD 03 > 62 FD 03 {200_000:08x}
        22 F1 91 > 62 F1 91 {b"bench".hex()}
        22 FD 02 > 62 FD 02 {1:08x}
        2E FD 02 {both} > 6E FD 02
        2E FD 02 {both} > 6E FD 02
        2E FD 02 {keys(1).hex()} > OUT_OF_RANGE
        22 FD 02 > 62 FD 02 {2:08x}
        """
    )
    client.ecu.is_wanted = True
    client.talk(f"2E FD 02 {both} > ok\n2E FD 02 {keys(3).hex()} > CONDITIONS_NOT_CORRECT")
    client.talk("31 01 02 07 > CONDITIONS_NOT_CORRECT")
    client.memory.kept.pop(RecordKind.KEYS)
    client.ecu.power_on()
    client.talk("22 FD 02 > 62 FD 02 00 00 00 00")


def test_a_memory_that_fails_is_a_programming_failure(client):
    client.programming()
    client.announce(NEWER)
    client.memory.broken = True
    client.talk(
        f"""
        34 00 44 00x4 {LENGTH} > ok
        36 01 AA > PROGRAMMING_FAILURE
        36 01 AA > SEQUENCE_ERROR
        31 01 FF 00 00 00 01 00 00x32 > PROGRAMMING_FAILURE
        2E FD 02 {keys(2).hex()} > PROGRAMMING_FAILURE
        10 02 > ok
        """
    )
    answer = KEY.answer(Level.PROGRAMMING, client.ask(b"\x27\x01")[2:])
    assert client.ask(b"\x27\x02" + answer) == refused(0x27, Nrc.PROGRAMMING_FAILURE)


OWN, OTHER = REFERENCE.pack(), changed(lift=0.5).pack()
NEGATIVE, NAN = (OWN[:8] + lift + OWN[12:] for lift in (b"\0\0\x80\xbf", b"\0\0\xc0\x7f"))


class Kept:
    def __init__(self, raw: bytes | None = None, refusal: Nrc | None = None) -> None:
        self.raw, self.is_worn_out, self.writes = raw, False, 0
        self.segment = Segment(REFERENCE, LIMITS)
        self.service = CalibrationService(self.segment, kept=lambda: self.raw, keep=self._keep, refusal=lambda: refusal)

    def _keep(self, raw: bytes | None) -> None:
        if self.is_worn_out:
            raise MediumError("no place is left that works")
        self.raw, self.writes = raw, self.writes + 1

    def refuse(self, did: Did, value: bytes, code: Nrc) -> None:
        with pytest.raises(Refused) as refusal:
            self.service.write(did, value)
        assert refusal.value.code is code, (did, value)


def test_values_that_are_not_allowed_are_refused_whole():
    kept = Kept()
    for value in (NEGATIVE, NAN, changed(delay_steps=7).pack(), b"", bytes(43)):
        kept.refuse(Did.CALIBRATION, value, Nrc.OUT_OF_RANGE)
        assert (kept.service.read(Did.CALIBRATION), kept.segment.take()) == (OWN, None)
    for value in (b"", b"\x02", b"\xff", b"\x01\x01"):
        kept.refuse(Did.CALIBRATION_STORED, value, Nrc.OUT_OF_RANGE)


def test_what_is_stored():
    """The page in force is; going back where nothing is stored writes nothing; a memory that fails is reported."""
    kept = Kept()
    kept.service.write(Did.CALIBRATION, OTHER)
    kept.segment.page = Page.REFERENCE
    kept.service.store(kept.segment.in_force)
    assert kept.service.read(Did.CALIBRATION) == kept.raw == OWN
    kept = Kept(refusal=Nrc.CONDITIONS_NOT_CORRECT)
    kept.service.write(Did.CALIBRATION, OTHER)
    kept.refuse(Did.CALIBRATION_STORED, b"\x01", Nrc.CONDITIONS_NOT_CORRECT)
    kept.service.write(Did.CALIBRATION_STORED, b"\x00")
    assert (kept.service.read(Did.CALIBRATION), kept.writes) == (OWN, 0)
    kept = Kept(OTHER)
    kept.service.restore()
    kept.is_worn_out = True
    for value in (b"\x00", b"\x01"):
        kept.refuse(Did.CALIBRATION_STORED, value, Nrc.PROGRAMMING_FAILURE)
    assert kept.service.read(Did.CALIBRATION) == OTHER
    # A record that this vehicle does not allow is not used.
    for raw in (b"", bytes(45), changed(action_limit=0.08).pack(), NAN):
        kept = Kept(raw)
        assert "calibration" in str(kept.service.restore())
        assert (kept.segment.take(), kept.raw) == (None, raw)
