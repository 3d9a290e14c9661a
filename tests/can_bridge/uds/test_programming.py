"""The sequence of programming, request by request, over a real store.

What the store itself decides is tested in `tests/can_bridge/flashing`; here, how its answers come over the wire.
"""

from itertools import islice

import pytest

from can_bridge.flashing import report
from can_bridge.flashing.access_level import Level
from can_bridge.flashing.backing import Kind
from can_bridge.flashing.medium import MediumError
from can_bridge.flashing.state import Phase
from can_bridge.flashing.verdicts import Verdict
from can_bridge.uds.services import MAX_BLOCK, Did, Nrc, Routine, Session
from tests.can_bridge.flashing.plain_backing import PlainBacking
from tests.can_bridge.flashing.releases import RELEASE, SECOND, image, keys, phases, provisioned
from tests.can_bridge.flashing.store_ecu import KEY, FlashingSteps, StoreEcu
from tests.can_bridge.uds.scripted_ecu import MS, payload, refused

NEWER = image("newer", version=2)
BLOCK = MAX_BLOCK - 2
CAPACITY = 200_000
KEY_LIST, STORE = Did.KEY_LIST.to_bytes(2, "big"), Did.STORE.to_bytes(2, "big")


class Client(FlashingSteps):
    """Knows the key, and drives the ECU's clock."""

    def __init__(self) -> None:
        self.memory: PlainBacking = provisioned()
        self.ecu = StoreEcu(lambda: self.memory)
        self.now_ns = 0

    def ask(self, *parts: int | bytes) -> bytes:
        """The last answer."""
        answers = self.ecu.server.request(self.now_ns, payload(*parts))
        while self.ecu.server.is_busy and not self.ecu.is_reset:
            self.now_ns += MS
            answers += self.ecu.server.tick(self.now_ns)
        return answers[-1]

    def routine(self, number: Routine, option: bytes = b"") -> bytes:
        return self.ask(0x31, 1, number.to_bytes(2, "big"), option)

    def download(self, offset: int, length: int) -> bytes:
        return self.ask(0x34, 0x00, 0x44, offset.to_bytes(4, "big"), length.to_bytes(4, "big"))

    def send(self, new: bytes, *, offset: int = 0, blocks: int | None = None) -> None:
        """So many blocks; all of them, and the exit, if none is given."""
        for _ in islice(self.blocks(new, offset, BLOCK), blocks):
            pass

    def reset(self) -> None:
        """As the vehicle does it; afterwards locked, in the default session."""
        assert self.ask(0x11, 1) == b"\x51\x01"
        assert self.ecu.is_reset
        self.ecu.power_on()

    def running(self) -> str:
        """By the STORE identifier."""
        slot = report.decode(self.ask(0x22, STORE)[3:]).running_slot
        return "" if slot is None else slot.name


@pytest.fixture
def client() -> Client:
    return Client()


def test_a_release_is_flashed_and_confirmed(client):
    assert client.write(NEWER) == Verdict.GOOD
    assert client.running() == "one"
    # Confirmation is for what runs on trial.
    for _ in range(2):
        assert client.routine(Routine.CONFIRM) == refused(0x31, Nrc.SEQUENCE_ERROR)
        # A tester that missed an answer is answered alike.
        assert client.routine(Routine.ACTIVATE) == b"\x71\x01\x02\x05"
    assert phases(client.ecu.store) == [Phase.CONFIRMED, Phase.TRIAL]
    client.reset()
    assert client.running() == "newer"
    client.programming()
    assert client.routine(Routine.SELF_TEST) == b"\x71\x01\x02\x04"
    assert client.routine(Routine.CONFIRM) == client.routine(Routine.CONFIRM) == b"\x71\x01\x02\x06"
    # There is no way back to what is too old now.
    assert client.routine(Routine.REVERT) == refused(0x31, Nrc.CONDITIONS_NOT_CORRECT)
    client.ecu.power_on()
    assert (client.running(), client.ecu.store.state.least_security_version) == ("newer", 2)
    # A tester whose release was given up must not take the one before for its own.
    client.programming()
    assert client.routine(Routine.CONFIRM) == refused(0x31, Nrc.SEQUENCE_ERROR)


def test_only_the_bytes_that_are_missing_are_taken(client):
    client.programming()
    for length in (0, CAPACITY + 1, 2**32 - 1):
        answer = client.routine(Routine.ERASE, length.to_bytes(4, "big") + bytes(32))
        assert answer == refused(0x31, Nrc.OUT_OF_RANGE), length
    assert client.download(0, 100) == refused(0x34, Nrc.SEQUENCE_ERROR)
    assert client.routine(Routine.CHECK) == refused(0x31, Nrc.SEQUENCE_ERROR)
    client.announce(NEWER)
    for offset, less in ((1, 1), (0, 1), (0, -1), (1, 0), (2**32 - 1, 0)):
        if offset != 1 or less != 1:
            assert client.download(offset, len(NEWER) - less) == refused(0x34, Nrc.OUT_OF_RANGE), (offset, less)
    client.send(NEWER, blocks=3)
    assert client.verdict() == Verdict.INCOMPLETE
    assert client.routine(Routine.ACTIVATE) == refused(0x31, Nrc.SEQUENCE_ERROR)
    assert client.announce(image("another")) == 0


def test_key_lists(client):
    both = keys(2, RELEASE, SECOND)
    client.programming()
    for raw, answer in (
        (both, b"\x6e\xfd\x02"),
        (both, b"\x6e\xfd\x02"),  # the first answer may have been missed
        *((raw, refused(0x2E, Nrc.OUT_OF_RANGE)) for raw in (keys(1), keys(9)[:-1], keys(9) + b"\n")),
    ):
        assert client.ask(0x2E, KEY_LIST, raw) == answer, raw
    assert client.ask(0x22, KEY_LIST) == b"\x62\xfd\x02\0\0\0\x02"
    client.memory.memory.records.pop(Kind.KEYS)
    client.ecu.power_on()
    assert client.ask(0x22, KEY_LIST) == b"\x62\xfd\x02" + bytes(4)


def test_a_memory_that_fails_is_a_programming_failure(client, monkeypatch):
    def fail(*_: object) -> None:
        raise MediumError("worn out", 0)

    client.programming()
    client.announce(NEWER)
    monkeypatch.setattr(client.memory, "keep", fail)
    monkeypatch.setattr(client.memory, "append", fail)
    client.download(0, len(NEWER))
    assert client.ask(0x36, 1, b"abc") == refused(0x36, Nrc.PROGRAMMING_FAILURE)
    assert client.ask(0x36, 1, b"abc") == refused(0x36, Nrc.SEQUENCE_ERROR)
    answer = client.routine(Routine.ERASE, bytes([0, 0, 1, 0]) + bytes(32))
    assert answer == refused(0x31, Nrc.PROGRAMMING_FAILURE)
    assert client.ask(0x2E, KEY_LIST, keys(2)) == refused(0x2E, Nrc.PROGRAMMING_FAILURE)
    client.ask(0x10, Session.PROGRAMMING)
    seed = client.ask(0x27, 1)[2:]
    answer = client.ask(0x27, 2, KEY.answer(Level.PROGRAMMING, seed))
    assert answer == refused(0x27, Nrc.PROGRAMMING_FAILURE)


def test_identifiers(client):
    assert client.ask(0x22, Did.CAPACITY.to_bytes(2, "big")) == b"\x62\xfd\x03" + CAPACITY.to_bytes(4, "big")
    assert client.ask(0x22, KEY_LIST) == b"\x62\xfd\x02\0\0\0\x01"
    assert client.ask(0x22, Did.HARDWARE.to_bytes(2, "big")) == b"\x62\xf1\x91bench"
