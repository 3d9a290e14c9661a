"""The fault memory and its services: statuses over power cycles, and each answer as bytes."""

import pytest

from can_bridge.flashing.backing import MediumError
from can_bridge.uds.fault_memory import AGED_CYCLES, CODES, FaultMemory, FaultReport, in_letters
from can_bridge.uds.services import Nrc, Refused, Session
from can_bridge.wire.messages import Reason
from tests.can_bridge.uds.scripted_ecu import Bench, S

LOST, SENSOR = Reason.STREAM_LOST, Reason.SENSOR_INVALID
SNAPSHOT = bytes.fromhex("0000ffff 02 0003 0000 3f800000 bf000000 00000000 3e800000")


class Memory:
    def __init__(self) -> None:
        self.record, self.writes, self.fails = b"", 0, False
        self.refusal: Nrc | None = None
        self.power_on()

    def power_on(self) -> FaultMemory:
        self.now = FaultMemory(self.record, keep=self._keep, refusal=lambda: self.refusal)
        return self.now

    def note(self, reason: Reason | None) -> None:
        self.now.note(reason, SNAPSHOT)
        self.now.settle()

    def status(self, reason: Reason = LOST) -> int:
        return int(self.now.faults[reason].status)

    def _keep(self, record: bytes) -> None:
        if self.fails:
            raise MediumError("worn")
        self.record, self.writes = record, self.writes + 1


@pytest.fixture
def memory() -> Memory:
    return Memory()


@pytest.fixture
def bench(memory) -> Bench:
    return Bench(faults=memory.now)


def test_every_reason_that_is_a_fault_has_a_code_of_its_own():
    states = {Reason.NONE, Reason.NOT_ARMED, Reason.UPDATING, Reason.OFF_SPEED}
    assert {*CODES} == {*Reason} - states
    assert len({*CODES.values()}) == len(CODES)
    assert [in_letters(CODES[one]) for one in (LOST, SENSOR, Reason.NO_SPEED)] == ["U1101-87", "P1106-86", "U1110-87"]


def test_statuses_over_operation_cycles(memory):
    """The status by the bits of ISO 14229-1, table D.1."""
    assert memory.status() == 0x50
    memory.note(None)
    assert memory.status() == 0x00
    memory.note(LOST)
    assert (memory.status(), memory.status(SENSOR)) == (0x2F, 0x00)
    memory.note(None)
    assert memory.status() == 0x2E
    # One further cycle without a test, one with a failure, then clean ones.
    memory.power_on()
    assert memory.status() == 0x6C
    memory.power_on()
    memory.note(LOST)
    assert memory.status() == 0x2F
    for cycle in range(AGED_CYCLES):
        memory.power_on()
        assert (memory.status(), memory.now.faults[LOST].age) == (0x68 if cycle else 0x6C, cycle)
        memory.note(None)
    memory.power_on()
    assert (memory.status(), memory.now.faults[LOST].snapshot, memory.now.faults[LOST].age) == (0x60, b"", 0)


def test_little_is_written_and_nothing_while_jets_run(memory):
    """Any course of statuses is compared with the memory in C, in `tests/proofs/loader_in_c`."""
    for reason in (*CODES, None, *CODES, None, *CODES):
        memory.note(reason)
    assert memory.writes <= len(CODES) + 1
    memory.now.clear(CODES)
    memory.refusal, before = Nrc.CONDITIONS_NOT_CORRECT, memory.writes
    memory.note(LOST)
    with pytest.raises(Refused):
        memory.now.clear(CODES)
    assert (memory.writes, memory.status()) == (before, 0x2F)
    memory.refusal = None
    for _ in range(2):
        memory.now.settle()
    assert memory.writes == before + 1 and memory.power_on().faults[LOST].snapshot == SNAPSHOT


def test_a_damaged_record_is_an_empty_memory_and_a_failing_one_is_tried_once(memory):
    memory.note(LOST)
    record = memory.record
    for damaged in (b"", record[:-1], record[:9] + b"\x00" + record[10:], b"SWF2" + record[4:], record + b"\x00"):
        memory.record = damaged
        assert {fault.status for fault in memory.power_on().faults.values()} == {0x50}, damaged
    memory.fails = True
    with pytest.raises(MediumError):
        memory.note(LOST)
    memory.now.settle()
    with pytest.raises(Refused):
        memory.now.clear([LOST])


def test_the_answers(bench, memory):
    """Numbers of the standard; the shortest code is that of STREAM_LOST, U1101-87."""
    taken = bytes.fromhex("fd20 0000ffff fd21 02 fd22 0003 fd23 0000 fd24") + SNAPSHOT[9:]
    bench.talk("19 01 FF > 59 01 7F 00 00 0E\n19 02 2F > 59 02 7F\n19 01 80 > 59 01 7F 00 00 00")
    memory.note(LOST)
    bench.talk(
        f"""
        19 01 08 > 59 01 7F 00 00 01
        19 02 08 > 59 02 7F D1 01 87 2F
        19 82 08 > -
        19 04 D1 01 87 01 > 59 04 D1 01 87 2F 01 05 {taken.hex(" ")}
        19 04 11 06 86 FF > 59 04 11 06 86 50
        19 06 D1 01 87 FF > 59 06 D1 01 87 2F 01 00
        19 04 D1 01 87 02 > OUT_OF_RANGE
        19 04 D1 01 88 01 > OUT_OF_RANGE
        14 D1 01 88 > OUT_OF_RANGE
        14 11 06 86 > 54
        19 01 08 > 59 01 7F 00 00 01
        14 FF FF FF > 54
        19 01 08 > 59 01 7F 00 00 00
        """
    )
    answer = bench.ask(0x19, FaultReport.SUPPORTED)
    assert answer is not None and len(answer) == 3 + 4 * len(CODES)
    memory.note(LOST)
    memory.refusal = Nrc.CONDITIONS_NOT_CORRECT
    bench.talk("14 FF FF FF > CONDITIONS_NOT_CORRECT\n19 01 08 > 59 01 7F 00 00 01")
    memory.refusal, memory.fails = None, True
    bench.talk("14 FF FF FF > PROGRAMMING_FAILURE")


def test_settings_last_as_long_as_sessions_beyond_the_default(bench, memory):
    bench.talk("10 03 > ok\n85 02 > C5 02\n28 01 01 > 68 01")
    memory.note(LOST)
    memory.note(SENSOR)
    memory.note(None)
    bench.talk("10 02 > ok")
    assert bench.server.is_silent and not memory.now.is_on
    bench.talk("85 01 > C5 01\n28 00 03 > 68 00")
    memory.now.settle()
    assert (bench.server.is_silent, memory.status(), memory.status(SENSOR)) == (False, 0, 0), "the last result alone"
    for end in (lambda: bench.ask(0x10, 1), lambda: bench.wait(5 * S)):
        bench.talk("10 03 > ok\n85 82 > -\n28 81 03 > -")
        assert bench.server.is_silent
        end()
        assert (bench.server.session, bench.server.is_silent, memory.now.is_on) == (Session.DEFAULT, False, True)
    bench.talk("10 03 > ok\n28 01 02 > OUT_OF_RANGE")
    bench.ecu.refusals["before_reset"] = Nrc.CONDITIONS_NOT_CORRECT
    bench.talk("28 01 01 > CONDITIONS_NOT_CORRECT\n28 00 01 > 68 00")
    assert not bench.server.is_silent
