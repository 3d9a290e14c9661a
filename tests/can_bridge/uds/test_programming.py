"""The sequence of programming, request by request, over a real store."""

import hashlib
from random import Random

import pytest

from benchmarks.flash.fuzz_ecu import CAPACITY, KEY, FuzzedEcu
from benchmarks.flash.fuzz_images import pool
from can_bridge.flashing import report
from can_bridge.flashing.access_level import Level
from can_bridge.flashing.backing import Kind, Slot
from can_bridge.flashing.medium import MediumError
from can_bridge.flashing.state import Phase
from can_bridge.flashing.verdicts import Verdict
from can_bridge.uds.services import MAX_BLOCK, Did, Nrc, Routine, Session
from tests.can_bridge.uds.scripted_ecu import MS, S, payload, refused

IMAGES = pool().images
BLOCK = MAX_BLOCK - 2


class Client:
    """Knows the key, and drives the ECU's clock."""

    def __init__(self) -> None:
        self.ecu = FuzzedEcu(Random(0))
        self.now_ns = 0

    def ask(self, *parts: int | bytes) -> bytes:
        """The last answer."""
        answers = self.ecu.server.request(self.now_ns, payload(*parts))
        while self.ecu.server.is_busy and not self.ecu.is_reset:
            self.now_ns += MS
            answers += self.ecu.server.tick(self.now_ns)
        return answers[-1]

    def unlock(self) -> None:
        assert self.ask(0x10, Session.PROGRAMMING)[0] == 0x50
        seed = self.ask(0x27, 1)[2:]
        assert self.ask(0x27, 2, KEY.answer(Level.PROGRAMMING, seed)) == b"\x67\x02"

    def routine(self, number: Routine, option: bytes = b"") -> bytes:
        return self.ask(0x31, 1, number.to_bytes(2, "big"), option)

    def announce(self, image: bytes) -> int:
        """The offset wanted."""
        answer = self.routine(Routine.ERASE, len(image).to_bytes(4, "big") + hashlib.sha256(image).digest())
        assert answer[:4] == b"\x71\x01\xff\x00" and len(answer) == 8
        return int.from_bytes(answer[4:], "big")

    def download(self, offset: int, length: int) -> bytes:
        return self.ask(0x34, 0x00, 0x44, offset.to_bytes(4, "big"), length.to_bytes(4, "big"))

    def send(self, image: bytes, *, offset: int = 0, blocks: int | None = None) -> None:
        """So many blocks; all of them, and the exit, if none is given."""
        assert self.download(offset, len(image) - offset)[0] == 0x74
        for number, at in list(enumerate(range(offset, len(image), BLOCK), start=1))[:blocks]:
            assert self.ask(0x36, number, image[at : at + BLOCK]) == bytes([0x76, number])
        if blocks is None:
            assert self.ask(0x37) == b"\x77"

    def bring(self, name: str) -> Verdict:
        """A whole image, from a locked ECU; the verdict on it."""
        self.unlock()
        assert self.announce(IMAGES[name]) == 0
        self.send(IMAGES[name])
        return self.verdict()

    def verdict(self) -> Verdict:
        answer = self.routine(Routine.CHECK)
        assert answer[:4] == b"\x71\x01\xff\x01" and len(answer) == 5
        return Verdict(answer[4])

    def reset(self) -> None:
        """As the vehicle does it; afterwards locked, in the default session."""
        assert self.ask(0x11, 1) == b"\x51\x01"
        assert self.ecu.is_reset
        self.ecu.power_on()

    def running(self) -> str:
        """By the STORE identifier."""
        answer = self.ask(0x22, Did.STORE.to_bytes(2, "big"))
        slot = report.decode(answer[3:]).running_slot
        return "" if slot is None else slot.name

    def phases(self) -> list[Phase]:
        return [slot.phase for slot in self.ecu.store.state.slots]


@pytest.fixture
def client() -> Client:
    return Client()


def test_a_release_is_flashed_and_confirmed(client):
    assert client.bring("newer") == Verdict.GOOD
    assert client.running() == "first"
    assert client.routine(Routine.ACTIVATE) == b"\x71\x01\x02\x05"
    client.reset()
    assert client.running() == "newer"
    client.unlock()
    assert client.routine(Routine.SELF_TEST) == b"\x71\x01\x02\x04"
    assert client.routine(Routine.CONFIRM) == b"\x71\x01\x02\x06"
    client.ecu.power_on()
    assert client.running() == "newer"
    assert client.ecu.store.state.least_security_version == 2


@pytest.mark.parametrize(
    ("name", "verdict"),
    [
        ("old", Verdict.TOO_OLD),
        ("unsigned", Verdict.UNSIGNED),
        ("stranger's", Verdict.UNKNOWN_KEY),
        ("second", Verdict.UNKNOWN_KEY),
        ("other hardware's", Verdict.WRONG_HARDWARE),
        ("with another's signature", Verdict.BAD_SIGNATURE),
        ("with another graph", Verdict.DAMAGED),
        ("no image", Verdict.DAMAGED),
    ],
)
def test_what_fails_a_check_is_never_activated(client, name, verdict):
    assert client.bring(name) == verdict
    assert client.routine(Routine.ACTIVATE) == refused(0x31, Nrc.SEQUENCE_ERROR)
    client.reset()
    assert client.running() == "first"


def test_bytes_of_another_image_fail_the_hash(client):
    client.unlock()
    image = IMAGES["newer"]
    client.announce(image)
    client.send(image[:-1] + bytes([image[-1] ^ 1]))
    assert client.verdict() == Verdict.WRONG_HASH
    assert client.routine(Routine.ACTIVATE) == refused(0x31, Nrc.SEQUENCE_ERROR)


class TestPreconditions:
    def test_none_of_it_while_the_vehicle_asks_for_control(self, client):
        client.ecu.is_wanted = True
        assert client.ask(0x10, Session.PROGRAMMING) == refused(0x10, Nrc.CONDITIONS_NOT_CORRECT)
        assert client.ask(0x10, Session.EXTENDED)[0] == 0x50
        assert client.routine(Routine.PRECONDITIONS) == refused(0x31, Nrc.CONDITIONS_NOT_CORRECT)

    def test_nothing_is_erased_if_it_asks_later(self, client):
        client.unlock()
        client.ecu.is_wanted = True
        answer = client.routine(Routine.ERASE, bytes([0, 0, 1, 0]) + bytes(32))
        assert answer == refused(0x31, Nrc.CONDITIONS_NOT_CORRECT)
        assert not client.ecu.programming.is_updating

    def test_they_are_met_otherwise(self, client):
        client.ask(0x10, Session.EXTENDED)
        assert client.routine(Routine.PRECONDITIONS) == b"\x71\x01\x02\x03"

    def test_an_announcement_makes_an_update_until_the_reset(self, client):
        client.unlock()
        assert not client.ecu.programming.is_updating
        client.announce(IMAGES["newer"])
        client.ask(0x10, Session.DEFAULT)
        assert client.ecu.programming.is_updating
        client.ecu.power_on()
        assert not client.ecu.programming.is_updating


class TestReset:
    def test_not_while_the_vehicle_has_control_or_asks_for_it(self, client):
        client.ask(0x10, Session.PROGRAMMING)
        client.ecu.is_wanted = True
        assert client.ask(0x11, 1) == refused(0x11, Nrc.CONDITIONS_NOT_CORRECT)
        assert not client.ecu.is_reset

    def test_it_leads_out_of_an_update_whatever_the_vehicle_asks(self, client):
        client.unlock()
        client.announce(IMAGES["newer"])
        client.ecu.is_wanted = True
        client.reset()


class TestTransfer:
    @pytest.mark.parametrize("length", [0, CAPACITY + 1, 2**32 - 1])
    def test_length_that_fits_no_slot(self, client, length):
        client.unlock()
        answer = client.routine(Routine.ERASE, length.to_bytes(4, "big") + bytes(32))
        assert answer == refused(0x31, Nrc.OUT_OF_RANGE)

    def test_download_without_an_announcement(self, client):
        client.unlock()
        assert client.download(0, 100) == refused(0x34, Nrc.SEQUENCE_ERROR)

    @pytest.mark.parametrize(("offset", "less"), [(1, 1), (0, 1), (0, -1), (1, 0), (2**32 - 1, 0)])
    def test_download_of_other_bytes_than_those_missing(self, client, offset, less):
        client.unlock()
        client.announce(IMAGES["newer"])
        assert client.download(offset, len(IMAGES["newer"]) - less) == refused(0x34, Nrc.OUT_OF_RANGE)

    @pytest.mark.parametrize("end", ["session", "silence", "power"])
    def test_interrupted_transfer_goes_on_where_it_was(self, client, end):
        client.unlock()
        client.announce(IMAGES["newer"])
        client.send(IMAGES["newer"], blocks=3)
        if end == "session":
            client.ask(0x10, Session.DEFAULT)
        elif end == "silence":
            client.now_ns += 5 * S
        else:
            client.ecu.power_on()
        client.unlock()
        assert client.ask(0x36, 4, b"x") == refused(0x36, Nrc.SEQUENCE_ERROR)
        assert client.download(3 * BLOCK, len(IMAGES["newer"]) - 3 * BLOCK) == refused(0x34, Nrc.SEQUENCE_ERROR)
        assert client.announce(IMAGES["newer"]) == 3 * BLOCK
        client.send(IMAGES["newer"], offset=3 * BLOCK)
        assert client.verdict() == Verdict.GOOD

    def test_whole_image_needs_no_block_again(self, client):
        client.bring("newer")
        client.ecu.power_on()
        client.unlock()
        assert client.announce(IMAGES["newer"]) == len(IMAGES["newer"])
        assert client.verdict() == Verdict.GOOD

    def test_another_image_begins_at_its_start(self, client):
        client.unlock()
        client.announce(IMAGES["newer"])
        client.send(IMAGES["newer"], blocks=3)
        assert client.announce(IMAGES["newest"]) == 0

    def test_check_before_all_came(self, client):
        client.unlock()
        client.announce(IMAGES["newer"])
        client.send(IMAGES["newer"], blocks=3)
        assert client.verdict() == Verdict.INCOMPLETE
        assert client.routine(Routine.ACTIVATE) == refused(0x31, Nrc.SEQUENCE_ERROR)

    def test_check_without_an_image(self, client):
        client.unlock()
        assert client.routine(Routine.CHECK) == refused(0x31, Nrc.SEQUENCE_ERROR)

    def test_release_that_runs_is_not_written(self, client):
        before = bytes(client.ecu.memory.slots[Slot.A])
        for name in ("newer", "newest", "unsigned"):
            client.bring(name)
        assert bytes(client.ecu.memory.slots[Slot.A]) == before


class TestChoice:
    def test_confirmation_is_for_what_runs_on_trial(self, client):
        client.bring("newer")
        assert client.routine(Routine.CONFIRM) == refused(0x31, Nrc.SEQUENCE_ERROR)
        client.routine(Routine.ACTIVATE)
        assert client.routine(Routine.CONFIRM) == refused(0x31, Nrc.SEQUENCE_ERROR)
        assert client.phases() == [Phase.CONFIRMED, Phase.TRIAL]

    def test_what_is_confirmed_is_not_confirmed_again(self, client):
        """A tester whose release was given up must not take the one before for its own."""
        client.unlock()
        assert client.routine(Routine.CONFIRM) == refused(0x31, Nrc.SEQUENCE_ERROR)

    def test_repeated_requests_are_answered_alike(self, client):
        """The tester missed an answer."""
        client.bring("newer")
        assert client.verdict() == Verdict.GOOD
        assert client.routine(Routine.ACTIVATE) == client.routine(Routine.ACTIVATE) == b"\x71\x01\x02\x05"
        client.reset()
        client.unlock()
        assert client.routine(Routine.CONFIRM) == client.routine(Routine.CONFIRM) == b"\x71\x01\x02\x06"

    def test_trial_is_given_up(self, client):
        client.bring("newer")
        client.routine(Routine.ACTIVATE)
        client.reset()
        client.unlock()
        assert client.routine(Routine.REVERT) == client.routine(Routine.REVERT) == b"\x71\x01\x02\x07"
        client.reset()
        assert client.running() == "first"

    def test_no_way_back_where_there_is_none(self, client):
        client.unlock()
        assert client.routine(Routine.REVERT) == refused(0x31, Nrc.SEQUENCE_ERROR)

    def test_no_way_back_to_what_is_too_old_now(self, client):
        client.bring("newer")
        client.routine(Routine.ACTIVATE)
        client.reset()
        client.unlock()
        client.routine(Routine.CONFIRM)
        assert client.routine(Routine.REVERT) == refused(0x31, Nrc.CONDITIONS_NOT_CORRECT)
        client.reset()
        assert client.running() == "newer"


class TestKeys:
    def write(self, client: Client, raw: bytes) -> bytes:
        return client.ask(0x2E, Did.KEY_LIST.to_bytes(2, "big"), raw)

    def test_newer_list_lets_another_key_sign(self, client):
        client.unlock()
        assert self.write(client, pool().key_lists[1]) == b"\x6e\xfd\x02"
        assert client.ask(0x22, Did.KEY_LIST.to_bytes(2, "big")) == b"\x62\xfd\x02\0\0\0\x02"
        assert client.bring("second") == Verdict.GOOD

    @pytest.mark.parametrize("number", range(len(pool().foreign_lists)))
    def test_list_that_the_root_key_did_not_sign(self, client, number):
        client.unlock()
        assert self.write(client, pool().foreign_lists[number]) == refused(0x2E, Nrc.OUT_OF_RANGE)

    def test_list_whose_answer_was_missed(self, client):
        client.unlock()
        self.write(client, pool().key_lists[1])
        assert self.write(client, pool().key_lists[1]) == b"\x6e\xfd\x02"

    def test_older_list(self, client):
        client.unlock()
        self.write(client, pool().key_lists[2])
        assert self.write(client, pool().key_lists[1]) == refused(0x2E, Nrc.OUT_OF_RANGE)

    def test_key_revoked_during_the_trial_is_not_confirmed(self, client):
        """Its image would not boot, and the one before would be too old: no release would be left."""
        client.unlock()
        self.write(client, pool().key_lists[1])
        assert client.bring("second") == Verdict.GOOD
        client.routine(Routine.ACTIVATE)
        client.reset()
        client.unlock()
        assert self.write(client, pool().key_lists[2]) == b"\x6e\xfd\x02"
        assert client.routine(Routine.CONFIRM)[0] == 0x7F
        client.ecu.power_on()
        assert client.running() == "first"


class TestMemoryFails:
    @pytest.fixture
    def broken(self, client, monkeypatch) -> Client:
        """From the call of this fixture's `fail` on nothing can be written."""

        def fail(*_: object) -> None:
            raise MediumError("worn out", 0)

        client.unlock()
        client.announce(IMAGES["newer"])
        monkeypatch.setattr(client.ecu.memory, "keep", fail)
        monkeypatch.setattr(client.ecu.memory, "append", fail)
        return client

    def test_block(self, broken):
        broken.download(0, len(IMAGES["newer"]))
        assert broken.ask(0x36, 1, b"abc") == refused(0x36, Nrc.PROGRAMMING_FAILURE)
        assert broken.ask(0x36, 1, b"abc") == refused(0x36, Nrc.SEQUENCE_ERROR)

    def test_announcement(self, broken):
        answer = broken.routine(Routine.ERASE, bytes([0, 0, 1, 0]) + bytes(32))
        assert answer == refused(0x31, Nrc.PROGRAMMING_FAILURE)

    def test_key_list(self, broken):
        answer = broken.ask(0x2E, Did.KEY_LIST.to_bytes(2, "big"), pool().key_lists[1])
        assert answer == refused(0x2E, Nrc.PROGRAMMING_FAILURE)

    def test_attempt(self, broken):
        broken.ask(0x10, Session.PROGRAMMING)
        seed = broken.ask(0x27, 1)[2:]
        answer = broken.ask(0x27, 2, KEY.answer(Level.PROGRAMMING, seed))
        assert answer == refused(0x27, Nrc.PROGRAMMING_FAILURE)


def test_identifiers(client):
    assert client.ask(0x22, Did.CAPACITY.to_bytes(2, "big")) == b"\x62\xfd\x03" + CAPACITY.to_bytes(4, "big")
    assert client.ask(0x22, Did.KEY_LIST.to_bytes(2, "big")) == b"\x62\xfd\x02\0\0\0\x01"
    assert client.ask(0x22, Did.HARDWARE.to_bytes(2, "big")) == b"\x62\xf1\x91bench"
    client.ecu.memory.kept.pop(Kind.KEYS)
    client.ecu.power_on()
    assert client.ask(0x22, Did.KEY_LIST.to_bytes(2, "big")) == b"\x62\xfd\x02" + bytes(4)


def test_wrong_keys_are_counted_over_a_reset(client):
    for _ in range(3):
        client.ask(0x10, Session.PROGRAMMING)
        client.ask(0x27, 1)
        answer = client.ask(0x27, 2, bytes(16))
        client.ecu.power_on()
    assert answer == refused(0x27, Nrc.EXCEEDED_ATTEMPTS)
    client.ask(0x10, Session.PROGRAMMING)
    assert client.ask(0x27, 1) == refused(0x27, Nrc.DELAY_NOT_EXPIRED)
