"""Any sequence of requests, waits, and losses of power leaves the ECU with what it may have, and nothing else."""

import hashlib

import pytest
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, invariant, precondition, rule

from can_bridge.flashing.access_level import Level
from can_bridge.uds.services import MAX_BLOCK, Did, Nrc, Routine, Session
from tests.can_bridge.flashing.releases import provisioned
from tests.can_bridge.flashing.store_ecu import KEY, StoreEcu
from tests.can_bridge.uds.scripted_ecu import MS, S, payload
from tests.examples import examples
from tests.proofs.flash.fuzz_images import pool
from tests.proofs.flash.fuzz_witness import Witness

IMAGES = pool().images
BLOCK = MAX_BLOCK - 2
LEVELS = st.sampled_from(Level)
NAMES = st.sampled_from(sorted(IMAGES))


class AnySequence(RuleBasedStateMachine):
    """A tester that knows the key, one that does not, and a clock; with them what the standard requires of sessions."""

    def __init__(self) -> None:
        super().__init__()
        backing = provisioned()
        self.ecu = StoreEcu(lambda: backing)
        self.witness = Witness(self.ecu, backing)
        self.now_ns = 0
        self.session = Session.DEFAULT
        self.heard_ns = 0
        self.seeds: dict[Level, bytes] = {}

    def ask(self, *parts: int | bytes) -> bytes:
        """The last answer, empty if there was none."""
        request = payload(*parts)
        self.now_ns += MS
        self.witness.before(request)
        answers = self.ecu.server.request(self.now_ns, request)
        self.witness.look()
        while self.ecu.server.is_busy and not self.ecu.is_reset:
            self.now_ns += MS
            answers += self.ecu.server.tick(self.now_ns)
            self.witness.look()
        self.witness.after(self.now_ns, request, answers)
        self.heard_ns = self.now_ns if request else self.heard_ns
        last = answers[-1] if answers else b""
        if last[:1] == b"\x50":
            self.session = Session(last[1])
        if last[:1] == b"\x67" and len(last) == 18:
            self.seeds[Level(last[1])] = last[2:]
        if self.ecu.is_reset:
            self.power_cycle()
        return last

    @rule(session=st.sampled_from(Session))
    def control_session(self, session):
        answer = self.ask(0x10, session)
        refused = session is Session.PROGRAMMING and self.ecu.is_wanted
        assert answer[:2] == (bytes([0x7F, 0x10]) if refused else bytes([0x50, session]))

    @rule(level=LEVELS)
    def ask_for_a_seed(self, level):
        self.ask(0x27, level)

    @rule(level=LEVELS)
    def send_the_right_key(self, level):
        self.ask(0x27, level + 1, KEY.answer(level, self.seeds.get(level, bytes(16))))

    @rule(level=LEVELS, guess=st.one_of(st.just(bytes(16)), st.binary(min_size=15, max_size=17)))
    def send_a_guess(self, level, guess):
        self.ask(0x27, level + 1, guess)

    @rule(level=LEVELS)
    def unlock(self, level):
        self.control_session(Session.PROGRAMMING if level is Level.PROGRAMMING else Session.EXTENDED)
        self.ask_for_a_seed(level)
        self.send_the_right_key(level)

    @rule(name=NAMES, most=st.integers(0, 9))
    def send_an_image(self, name, most):
        """From where the ECU wants it, so many blocks of it."""
        image = IMAGES[name]
        answer = self.ask(0x31, 1, b"\xff\x00", len(image).to_bytes(4, "big"), hashlib.sha256(image).digest())
        if answer[:1] != b"\x71":
            return
        offset = int.from_bytes(answer[4:], "big")
        self.ask(0x34, 0x00, 0x44, offset.to_bytes(4, "big"), (len(image) - offset).to_bytes(4, "big"))
        for number, at in list(enumerate(range(offset, len(image), BLOCK), start=1))[:most]:
            assert self.ask(0x36, number, image[at : at + BLOCK])[:1] == b"\x76"
        self.ask(0x37)

    @rule(routine=st.sampled_from(sorted(set(Routine) - {Routine.ERASE})))
    def start_a_routine(self, routine):
        self.ask(0x31, 1, routine.to_bytes(2, "big"))

    @rule(name=NAMES)
    def flash(self, name):
        """All that a tester with the key does."""
        self.unlock(Level.PROGRAMMING)
        self.send_an_image(name, most=9)
        for routine in (Routine.CHECK, Routine.ACTIVATE):
            self.start_a_routine(routine)
        self.ask(0x11, 1)
        self.unlock(Level.PROGRAMMING)

    @rule(raw=st.sampled_from([*pool().key_lists, *pool().foreign_lists]))
    def write_a_key_list(self, raw):
        self.ask(0x2E, Did.KEY_LIST.to_bytes(2, "big"), raw)

    @rule(raw=st.binary(max_size=40))
    def send_anything(self, raw):
        answer = self.ask(raw)
        if raw and answer:
            assert answer[0] == raw[0] + 0x40 or (answer[:2] == bytes([0x7F, raw[0]]) and answer[2] in frozenset(Nrc))

    @rule(nanoseconds=st.sampled_from([MS, 2 * S, 5 * S, 10 * S]))
    def wait(self, nanoseconds):
        self.now_ns += nanoseconds
        assert self.ecu.server.tick(self.now_ns) == []

    @rule(is_wanted=st.booleans())
    def vehicle_asks_for_control(self, is_wanted):
        self.ecu.is_wanted = is_wanted

    @rule()
    def power_cycle(self):
        self.session = Session.DEFAULT
        self.seeds.clear()
        self.witness.powered_on(self.now_ns, self.ecu.power_on())

    @precondition(lambda self: self.now_ns - self.heard_ns >= 5 * S)
    @rule()
    def after_silence_all_is_shut(self):
        assert self.ecu.server.session is Session.DEFAULT
        assert self.ecu.server.unlocked is None

    @invariant()
    def session_is_the_standard_s(self):
        if self.now_ns - self.heard_ns >= 5 * S:
            self.session = Session.DEFAULT
        assert self.ecu.server.session is self.session

    @invariant()
    def nothing_is_found(self):
        self.witness.look()
        assert self.witness.found.total() == 0, self.witness.found


TestAnySequence = pytest.mark.slow(AnySequence.TestCase)
TestAnySequence.settings = examples(60, stateful_step_count=30, deadline=None)
