"""The node in C against the flashable ECU: the same frames at the same times; faults that are planted are noticed."""

from collections import Counter
from collections.abc import Sequence
from functools import partial
from pathlib import Path
from tempfile import mkdtemp
from typing import Any
from unittest.mock import patch

import pytest

from can_bridge.flashing import remembered
from can_bridge.flashing.backing import RecordKind, Slot
from can_bridge.flashing.checking import Rules
from can_bridge.flashing.remembered import Remembered
from can_bridge.flashing.state import SlotPhase
from can_bridge.flashing.store import Store
from can_bridge.isotp import control_info
from can_bridge.uds import security
from can_bridge.uds.ecu_services import EcuServices
from can_bridge.uds.security import SecurityAccess
from can_bridge.uds.services import Session
from can_bridge.wire.frame import Frame
from contract.errors import ConfigError
from tests.proofs.ecu_in_c.branch_coverage import branches, is_possible, without_reason
from tests.proofs.ecu_in_c.planted import Planted, listed
from tests.proofs.loader_in_c.node_library import QUICK, SESSION, Library, build, sources
from tests.proofs.loader_in_c.node_plans import confirmations, overtaken
from tests.proofs.loader_in_c.node_program import play, play_plan
from tests.proofs.loader_in_c.node_slow import STORIES
from tests.proofs.loader_in_c.node_states import visited
from tests.proofs.loader_in_c.node_twin import CONFIGS, MS, Twins, World, as_in_c, frame_to, world
from tests.proofs.loader_in_c.proof import sizes
from tests.proofs.loader_in_c.xcp_tool import ask_what_is_rare

pytestmark = pytest.mark.compiler


def confirm_without_a_trial(self: Any) -> None:
    for slot, standing in zip(Slot, self._store.state.slots, strict=True):
        if standing.phase in (SlotPhase.CHECKED, SlotPhase.TRIAL):
            self._store._confirm(slot)


PLANTED_IN_PYTHON = (
    (security, "compare_digest", lambda right, given: given in (right, bytes(16))),
    (SecurityAccess, "lock", lambda self: None),
    (SecurityAccess, "power_on", lambda self, now_ns: None),
    (Remembered, "keep_failed_attempts", lambda self, level, count: None),
    (Store, "take_keys", lambda self, raw: self.backing.keep(RecordKind.KEYS, raw)),
    (remembered, "Rules", lambda rules=Rules, **given: rules(**{**given, "least_security_version": 0})),
    (Store, "_writable_slot", lambda self: self.state.active or Slot.A),
    (EcuServices, "_confirm", confirm_without_a_trial),
)
"""Owner, name, and what stands there instead: defects of the Python ECU, which the one in C does not have."""
MOST_SEEDS = 400
PLANTED = listed(Path(__file__).with_name("node_planted.toml"))


def noticed(fault: Planted, folder: Path) -> bool:
    """Whether the comparison fails with it; raises ValueError if the sources no longer have the place."""
    for kind, config in CONFIGS.items():
        contents = fault.into(sources(config))
        # A library that is loaded stays: each needs a path of its own. A planted fault may look odd to the compiler.
        of = world(kind, Library(contents, build(contents, Path(mkdtemp(dir=folder)), "node.so", (*QUICK, "-w"))))
        seeds = range(MOST_SEEDS)
        if play_plan(of, confirmations(of)).differences or any(play(of, seed).differences for seed in seeds):
            return True
    return False


@pytest.fixture(scope="module", params=CONFIGS)
def of(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> World:
    contents = sources(CONFIGS[request.param])
    folder = tmp_path_factory.mktemp("node")
    return world(request.param, Library(contents, build(contents, folder / request.param, f"{request.param}.so")))


def test_both_send_the_same_frames_at_the_same_times(of: World) -> None:
    seen = Counter[str]()
    for seed in range(3):
        played = play(of, seed)
        assert played.differences == [], seed
        seen += played.seen
    assert {"50", "67", "71"} <= seen.keys() and seen.total() > 90


def test_in_every_state_both_answer_alike(of: World) -> None:
    twins, met = visited(of, "quick", 400, 8)
    assert twins.differences == [] and len({state for state, _ in met}) > 6 and len(met) > 60


class Listened:
    """Both ECUs in the extended session, looked at every 10 ms."""

    def __init__(self, of: World) -> None:
        self.twins, self.frame = Twins(of), partial(frame_to, of.config.bus)
        self.single(b"\x10\x03")

    def single(self, *requests: bytes) -> list[Frame]:
        return self.look([self.frame(control_info.single(request)) for request in requests])

    def look(self, frames: Sequence[Frame] = (), looks: int = 1) -> list[Frame]:
        """The frames in the first look of so many; what was sent in all."""
        sent = list[Frame]()
        for number in range(looks):
            sent += self.twins.service(frames if number == 0 else [])
            self.twins.now_ns += 10 * MS
        assert self.twins.differences == []
        return sent

    @property
    def lasts(self) -> bool:
        return self.twins.c.fact(SESSION) == Session.EXTENDED

    def ends_after(self) -> float:
        """Seconds."""
        began = self.twins.now_ns
        while self.lasts:
            self.look()
        return (self.twins.now_ns - began) / (1000 * MS)


def test_a_session_lasts_while_a_message_is_on_its_way(of: World) -> None:
    is_fd, whole = of.config.bus.frames == "fd", b"\x36" + bytes(4079)
    with as_in_c(of):
        # A request in classic frames as a slow adapter sends them, and in CAN FD ones slower still.
        for length, looks in ((8, 1), (64, 10)) if is_fd else ((8, 1),):
            tested, size = Listened(of), length - 1
            pieces = [whole[at : at + size] for at in range(length - 2, len(whole), size)]
            rest = [control_info.consecutive(number % 16, piece) for number, piece in enumerate(pieces, start=1)]
            first = tested.frame(control_info.first(whole, length))
            sent = [tested.look([frame], looks) for frame in (first, *map(tested.frame, rest))]
            assert [one[0].data[:4] for one in sent if one] == [b"\x30\0\0\xcc", b"\x03\x7f\x36\x7f"]
            assert tested.twins.now_ns > 5500 * MS and tested.ends_after() == pytest.approx(5.0, abs=0.15)
            # One that is not gone on with counts as silence once the next frame is overdue.
            tested = Listened(of)
            tested.look([first])
            assert tested.ends_after() == pytest.approx(6.0, abs=0.05)
        # An answer whose frames a tester takes one by one, 0.9 s apart.
        tested = Listened(of)
        (first,) = tested.single(b"\x22" + (5 if is_fd else 3) * b"\xfd\x01")
        size = int.from_bytes(first.data[:2], "big") & 0xFFF
        for _ in range(size - len(first.data) + 2, 0, 1 - len(first.data)):
            assert tested.lasts and len(tested.look([tested.frame(b"\x30\x01\0")], looks=90)) == 1
        assert tested.twins.now_ns > 6000 * MS and tested.lasts


def test_no_answer_is_dropped_in_silence(of: World) -> None:
    """Requests before the answer to another one is on the bus are refused, but for a flood, and none is carried out."""
    is_fd = of.config.bus.frames == "fd"
    with as_in_c(of):
        for count, refused in ((1, 0), (4, 3), (20, 5)):
            tested = Listened(of)
            assert [one.data[:2] for one in tested.single(*count * [b"\x22\xfd\x11"])] == [b"\x10\x87"]
            # Whatever else a tester wants meanwhile; that it is there needs no answer.
            tested.single(b"\x10\x01", b"\x3e\x80")
            sent = tested.look([tested.frame(b"\x30\0\0")], looks=9)
            assert sum(one.data[0] >> 4 == 2 for one in sent) == (2 if is_fd else 19)
            answers = [one.data[:4] for one in sent if one.data[0] == 3]
            assert answers == refused * [b"\x03\x7f\x22\x21"] + [b"\x03\x7f\x10\x21"]
            assert tested.lasts and tested.single(b"\x3e\0")[0].data[:3] == b"\x02\x7e\0"
        if is_fd:
            # The longest answer, and one that is longer.
            assert tested.single(b"\x22" + 6 * b"\xfd\x01")[0].data[:2] == (0x1000 + 1 + 6 * 121).to_bytes(2, "big")
            assert Listened(of).single(b"\x22" + 7 * b"\xfd\x01")[0].data[:4] == b"\x03\x7f\x22\x14"


def test_a_release_is_confirmed_after_its_self_test_alone(of: World) -> None:
    played = play_plan(of, confirmations(of))
    assert played.differences == []
    assert [slot.phase for slot in played.python.cycle.store.state.slots] == [SlotPhase.CONFIRMED, SlotPhase.FILLING]
    # For the boot before, without a test, after one that failed, behind another announcement; then twice.
    assert (played.seen["7f 3124"], played.seen["7f 3172"]) == (4, 1) and {"51", "74", "76", "77"} <= played.seen.keys()


def test_a_slow_memory_and_a_full_controller_are_waited_for(of: World) -> None:
    for story in STORIES:
        story(of)


@pytest.mark.parametrize("faults", [PLANTED[1:2], pytest.param(PLANTED, marks=pytest.mark.proofs)])
def test_planted_faults_are_noticed(faults: tuple[Planted, ...], tmp_path: Path) -> None:
    assert [fault for fault in faults if not noticed(fault, tmp_path)] == []


@pytest.mark.proofs  # hundreds of programs
def test_planted_faults_of_the_python_ecu_are_noticed_by_the_one_in_c(of: World) -> None:
    for owner, name, value in PLANTED_IN_PYTHON:
        # A store that takes no key list is noticed at production already.
        with patch.object(owner, name, value), pytest.raises((AssertionError, ConfigError)):
            for seed in range(300):
                assert play(of, seed).differences == []


@pytest.mark.proofs  # links it twice for a Cortex-M7; day to day tests/firmware_sim/mcu links it into its boards
def test_it_fits(tmp_path: Path) -> None:
    found = sizes(tmp_path)
    assert found["loader_flash_kib"] <= 48 and found["loader_ram_kib"] <= 8 and found["stack_b"] <= 2048, found
    assert found["xcp_flash_kib"] <= 5 and found["xcp_ram_kib"] <= 0.5, found


NAMES = "access calibrating daq isotp node programming services uds xcp xcp_access xcp_memory"
MEASURED = [f"sw_{name}.c" for name in NAMES.split()]
UNREACHED = {
    ("sw_access.c", "level, 0) != SW_STORE_DONE"): "the memory would have to fail between two records of one call",
    ("sw_daq.c", "switch (data[0]) { #13"): "the table of commands has no other",
    ("sw_isotp.c", "frame->length > SW_FRAME_BYTES"): "no CAN controller gives such a frame; the fuzzer does",
    ("sw_isotp.c", "if (end->queue.count == SW_ISOTP_QUEUE || length > room)"): "no request is begun without a place",
    ("sw_node.c", "sw_image_open(image, &numbers) == SW_IMAGE_OK"): "the boot judged the build before",
    ("sw_node.c", "sw_store_read_image(store"): "the memory would have to fail behind the judgement of the boot",
    ("sw_node.c", "if (sw_xcp_is_command(frame)) return 1;"): "the board's main asks this, no twin does",
    ("sw_node.c", "return node->ecu.unfit != SW_REASON_NONE"): "the networks' stand-in computes every known answer",
    ("sw_node.c", "if (now_ns < 0) return 0;"): "no clock here begins before 0; the fuzzer's does",
}


def missed(folder: Path, seeds: Sequence[int]) -> list[str]:
    """Branches of `MEASURED` that programs of these seeds do not take, and those of `UNREACHED` that they do."""
    found = Counter[str]()
    for kind, config in CONFIGS.items():
        place, contents = folder / kind, sources(config)
        library = Library(contents, build(contents, place, f"{kind}.so", (*QUICK, "--coverage", "-DHOST_COVERAGE")))
        of = world(kind, library)
        for seed in seeds:
            assert play(of, seed).differences == []
        assert play_plan(of, overtaken(of)).differences == []
        with as_in_c(of):
            ask_what_is_rare(Twins(of), of.config.bus)
        for story in STORIES:
            story(of)
        library.c.host_dump()
        for file, at, counts in branches(place):
            if file in MEASURED:
                found.update({f"{file}:{at} #{number}": taken for number, taken in enumerate(counts)})
    assert found, "gcovr found no branch"
    return without_reason([name for name, count in found.items() if count == 0], UNREACHED)


@pytest.mark.proofs  # two libraries without optimisation, and gcovr
@pytest.mark.skipif(not is_possible(), reason="gcc, or gcovr (extra dev), is not installed")
def test_every_branch_of_diagnosis_is_taken_or_named(tmp_path: Path) -> None:
    assert missed(tmp_path, range(150)) == []
    (tmp_path / "few").mkdir()
    assert missed(tmp_path / "few", range(1))
