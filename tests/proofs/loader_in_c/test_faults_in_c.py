"""The fault memory in C and in Python side by side: a course through every branch, and planted faults that it finds."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any
from zlib import crc32

import pytest

from can_bridge.flashing.backing import RecordKind
from can_bridge.uds.fault_memory import AGED_CYCLES, CODES, SNAPSHOT_BYTES
from can_bridge.wire.messages import Reason
from ecu.fail_safe import OperatingMode
from tests.proofs.ecu_in_c.branch_coverage import branches
from tests.proofs.ecu_in_c.planted import listed
from tests.proofs.loader_in_c.node_library import QUICK, Library, build, sources
from tests.proofs.loader_in_c.node_twin import CONFIGS, MS, Twins, as_in_c, world

LOST = CODES[Reason.STREAM_LOST].to_bytes(3, "big")
REPORTS = (*map(bytes.fromhex, ["1901ff", "190100", "1902ff", "190200", "190a"]), b"\x19\x04" + LOST + b"\x01")
PLANTED = listed(Path(__file__).with_name("faults_planted.toml"))


class Course:
    """Both ECUs, period by period; every difference ends it."""

    def __init__(self, of: Any, first: str | None = "one") -> None:
        self.twins = Twins(of, first=first)

    def periods(self, count: int, enable: bool | None) -> None:
        for _ in range(count):
            self.twins.control(enable)
            self.twins.ask()
            self.twins.now_ns += 20 * MS

    def ask(self, request: bytes) -> bytes:
        first = next((frame.data for frame in self.twins.ask(request)), b"\0\0")
        return first[2 : 2 + first[1]] if first[0] == 0 else first[1 : 1 + first[0]]

    def reports(self) -> None:
        for request in (*REPORTS, *(b"\x19\x06" + code.to_bytes(3, "big") + b"\xff" for code in CODES.values())):
            self.ask(request)

    def into_control(self) -> None:
        self.periods(8, False)
        self.periods(4, True)
        assert self.twins.python.state.fail_safe.mode is OperatingMode.CONTROL

    def next_cycle(self) -> None:
        """Through a reset, once the vehicle has asked for nothing for a second; then all reports."""
        self.periods(60, False)
        assert self.ask(b"\x10\x02")[0] == 0x50
        assert self.ask(b"\x11\x01")[0] == 0x51
        resets = self.twins.python.resets
        self.twins.service([])
        # No fault that is remembered: it shuts off because it is about to restart.
        self.twins.control(False)
        for _ in range(4):
            self.twins.service([])
            self.twins.now_ns += MS
        self.periods(2, None)
        assert self.twins.python.resets == resets + 1
        self.reports()


def live(of: Any, library: Library) -> None:
    course = Course(of)
    course.into_control()
    course.reports()
    assert course.ask(b"\x14\xff\xff\xff") == b"\x7f\x14\x22"
    for _ in range(2):
        course.periods(8, None)
        course.reports()
        course.into_control()
    course.next_cycle()
    for cycle in range(AGED_CYCLES + 4):
        course.into_control()
        if cycle == 2:
            course.periods(8, None)
            course.reports()
        course.next_cycle()
    # A controller that fails, and fails again as soon as the request rises.
    course.into_control()
    course.twins.fail(7)
    for _ in range(3):
        course.periods(8, False)
        assert course.ask(b"\x14\xff\xff\xff") == b"\x54"
        course.periods(4, True)
        course.periods(1, None)
        course.reports()
    course.twins.fail(0)
    # Off, on again in the middle of what happens, and by the end of the session.
    for request in (b"\x10\x03", b"\x85\x03", b"\x85\x01\x00", b"\x85\x02", b"\x28\x01\x01", b"\x28\x01\x03"):
        course.ask(request)
    course.into_control()
    course.periods(8, None)
    course.ask(b"\x85\x01")
    course.twins.control(None)
    course.reports()
    course.ask(b"\x85\x02")
    course.into_control()
    course.ask(b"\x85\x01")
    course.periods(8, None)
    odd = map(bytes.fromhex, ["14000000", "1400", "190300", "1901", "190400000001"])
    for request in (b"\x14" + LOST, *odd, b"\x19\x04" + LOST + b"\x02"):
        course.ask(request)
    course.reports()
    # A memory that takes nothing, first while nothing may be written to it anyway, and records that no ECU writes.
    for fails in (True, False):
        course.into_control()
        course.periods(8, None)
        if not fails:
            course.ask(b"\x14\xff\xff\xff")
        course.twins.fail(1)
        course.into_control()
        if fails:
            course.periods(8, None)
            assert course.ask(b"\x14\xff\xff\xff") == b"\x7f\x14\x72"
        course.twins.fail(0)
        course.next_cycle()
    kept = course.twins.backing.kept[RecordKind.FAULTS]
    statuses, ages = (0x08, 0x00, 0xFF), (7, 38, 39, 40, 254, 255)
    rows = [bytes([statuses[at // 6 % 3], ages[at % 6], at % 4]) for at in range(2 * len(CODES))]
    bodies = [b"SWF1" + b"".join(row + bytes(range(SNAPSHOT_BYTES)) for row in rows[at::2]) for at in range(2)]
    forged = [one + crc32(one).to_bytes(4, "big") for one in bodies]
    for damaged in (*forged, kept[:-1] + b"\x00", b"SWF2" + kept[4:], kept[:-1], kept):
        course.twins.backing.keep(RecordKind.FAULTS, damaged)
        assert library.c.host_keep_faults(course.twins.c._room, damaged, len(damaged)) == 0
        course.next_cycle()
    # A fault while a full sector is erased, which takes 200 looks, is kept once that has ended.
    while library.c.host_keep_faults(course.twins.c._room, kept, len(kept)) == 0:
        pass
    course.twins.c.set(200)
    course.periods(60, False)
    course.into_control()
    course.periods(8, None)
    course.periods(200, False)
    course.next_cycle()
    # Clocks: beyond what a snapshot's 4 bytes count, and from before power-on.
    for one, now_ns in ((course, course.twins.now_ns + 50 * 86_400_000 * MS), (Course(of), 0)):
        one.into_control()
        one.twins.now_ns = now_ns
        one.periods(1, True)
        assert one.twins.python.state.fail_safe.mode is OperatingMode.FAULT
        for code in CODES.values():
            one.ask(b"\x19\x04" + code.to_bytes(3, "big") + b"\x01")
    empty = Course(of, first=None)
    empty.periods(3, True)
    empty.reports()
    assert empty.twins.python.state.fail_safe.reason is Reason.NO_RELEASE


def lives(contents: Mapping[str, bytes], folder: Path, name: str, flags: tuple[str, ...] = QUICK) -> Library:
    library = Library(contents, build(contents, folder, f"{name}.so", flags))
    library.ffi.cdef("int host_keep_faults(void *, const uint8_t *, uint32_t);")
    of = world("fd", library)
    with as_in_c(of):
        live(of, library)
    return library


@pytest.mark.compiler
@pytest.mark.proofs  # compiles each
def test_both_live_alike_through_every_branch_and_a_planted_fault_is_found(tmp_path):
    own = Path(__file__).parent / "c" / "faults_host.c"
    contents = sources(CONFIGS["fd"]) | {own.name: own.read_bytes()}
    covered = lives(contents, tmp_path / "covered", "covered", (*QUICK, "--coverage", "-DHOST_COVERAGE"))
    covered.c.host_dump()
    assert [at for file, at, counts in branches(tmp_path / "covered") if file == "sw_faults.c" and 0 in counts] == []
    for number, fault in enumerate(PLANTED):
        with pytest.raises(AssertionError):
            lives(fault.into(contents), tmp_path / "planted", f"planted_{number}", (*QUICK, "-w"))
