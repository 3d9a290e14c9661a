"""A node whose flash memory takes its time, and whose CAN controller has few places: Python has no notion of either."""

import hashlib
from collections import Counter
from functools import partial
from typing import Final

from can_bridge.e2e.profiles import E2eSender
from can_bridge.flashing.state import Level
from can_bridge.isotp import control_info
from can_bridge.isotp.endpoint import Endpoint
from can_bridge.wire.frame import Frame
from can_bridge.wire.message_sets import message_set
from ecu.flashable.links import isotp_settings
from tests.can_bridge.flashing.store_ecu import KEY
from tests.proofs.loader_in_c.node_library import BUSY, DRIVES_JETS, WAITS, WANTS_RESET, WRITES, Host
from tests.proofs.loader_in_c.node_twin import MS, TEXTS, World, frame_to, pressures
from tests.proofs.loader_in_c.store_library import rules


class Slow:
    """A node with release "one", and a tester; a look is a millisecond."""

    def __init__(self, of: World) -> None:
        self.node, bus = Host(of.library, rules(of.vehicle), TEXTS, of.images["one"]), of.config.bus
        self.ids, self.frame = bus.diagnosis, partial(frame_to, bus)
        self.end = Endpoint(isotp_settings(bus, is_tester=True))
        self._pressures = E2eSender(message_set(bus).pressure.spec)
        self._emit = message_set(bus).pressure.emit
        self.now_ns, self.asks = MS, False
        self.frames = Counter[int]()

    def look(self, *frames: Frame) -> list[bytes]:
        """Whole answers that come in a millisecond."""
        sent = self.node.service(self.now_ns, [*self.end.poll(self.now_ns), *frames])
        self.frames[len(sent)] += 1
        for frame in sent:
            self.end.receive(self.now_ns, frame)
        self.now_ns += MS
        return self.end.take()

    def control(self, periods: int) -> None:
        """So many, 20 ms apart, with pressures; looks in between."""
        for _ in range(periods):
            sent = self._pressures.frame(self._emit(pressures(self.asks)), now_ns=self.now_ns)
            self.node.control(self.now_ns, [sent])
            for _ in range(20):
                self.look()

    def ask(self, request: bytes) -> list[tuple[int, bytes]]:
        """Answers, with the looks that each took."""
        self.end.send(request)
        found = list[tuple[int, bytes]]()
        for count in range(3000):
            found += [(count, answer) for answer in self.look()]
            if found and not (found[-1][1][0] == 0x7F and found[-1][1][2] == 0x78):
                return found
        raise AssertionError((request.hex(), found))

    def single(self, request: bytes) -> Frame:
        return self.frame(control_info.single(request))

    def unlock(self, level: int) -> list[tuple[int, bytes]]:
        seed = self.ask(bytes([0x27, level]))[-1][1]
        return self.ask(bytes([0x27, level + 1]) + KEY.answer(Level(level), seed[2:]))


def _about_to_erase(of: World, erase_ms: int) -> Slow:
    """More than half of a sector is written. It is left a second after power-on, and then blanked."""
    slow = Slow(of)
    slow.node.set(erase_ms)
    for _ in range(15):
        slow.ask(b"\x10\x03")
        slow.unlock(3)
    while slow.now_ns < 1020 * MS:
        slow.look()
    assert slow.ask(b"\x10\x03")[-1][1][0] == 0x50
    return slow


def erased_quickly(of: World) -> None:
    """A suppressed answer stays so if the erasure ends before its tester had to hear of it."""
    slow = _about_to_erase(of, 20)
    assert slow.look(slow.single(b"\x27\x83")) == [] and slow.node.fact(WAITS)
    assert [slow.look() for _ in range(200)] == [[]] * 200
    assert slow.ask(b"\x27\x04" + bytes(16))[-1][1] == b"\x7f\x27\x35"


def erased_beside(of: World) -> None:
    """What has to write waits for an erasure that is at work, and hears so; what only reads is answered at once."""
    slow = _about_to_erase(of, 200)
    if (every := slow.ids.functional) is not None:
        # One to every ECU waits as well, but for a longer one that is on its way to this.
        clear = slow.frame(control_info.single(b"\x14\xff\xff\xff"), every)
        slow.look(slow.frame(b"\x10\x40" + bytes(6)))
        assert [*slow.look(clear), *slow.look()] == [b"\x7f\x14\x21"]
    # A suppressed answer is sent after all, since its tester had to wait.
    frames = [slow.single(one) for one in (b"\x27\x83", b"\x3e\x80", b"\x22\xf1\x86")]
    assert slow.look(*frames) == [b"\x7f\x22\x21"]
    # The first of a longer message is refused meanwhile.
    first = slow.frame(b"\x10\x40" + bytes(6))
    assert slow.look(first) == slow.look() == [] and slow.node.fact(WAITS)
    found = [(count, answer) for count in range(250) for answer in slow.look()]
    assert [answer[:3] for _, answer in found] == [b"\x7f\x27\x78", b"\x67\x03" + found[1][1][2:3]]
    assert found[0][0] < 27 and found[1][0] > 100
    assert slow.unlock(3)[-1][1] == b"\x67\x04"
    image = of.images["newest"]
    slow.ask(b"\x10\x02")
    slow.unlock(1)
    announcement = len(image).to_bytes(4, "big") + hashlib.sha256(image).digest()
    assert not slow.node.fact(WAITS)
    (count, pending), (last, answer) = slow.ask(b"\x31\x01\xff\x00" + announcement)
    assert (pending, answer[:4], count < 40, last > 600) == (b"\x7f\x31\x78", b"\x71\x01\xff\x00", True, True)


def with_few_places(of: World) -> None:
    """No more frames than there is room for, and none is lost; a reset comes behind its answer."""
    slow = Slow(of)
    slow.node.set(0, 1)
    assert len(slow.ask(b"\x22\xfd\x01")[-1][1]) > 100 and max(slow.frames) == 1
    slow.node.set(0, 0)
    slow.look(slow.frame(b"\x10\x40" + bytes(6)))
    slow.end.send(b"\x10\x02")
    assert [slow.look() for _ in range(9)] == [[]] * 9 and not slow.node.fact(WAITS)
    slow.node.set(0, 8)
    assert slow.look()[0][:2] == b"\x50\x02"
    slow.node.set(0, 0)
    slow.end.send(b"\x11\x01")
    assert [slow.look() for _ in range(9)] == [[]] * 9 and not slow.node.fact(WANTS_RESET)
    slow.node.set(0, 3)
    assert slow.look() == [b"\x51\x01"] and slow.node.fact(WANTS_RESET) and slow.node.fact(WAITS)
    assert slow.node.service(slow.now_ns, []) == [] and slow.node.fact(BUSY)


def beside_jets(of: World) -> None:
    """No key is taken where it would have to be recorded in another sector, and nothing is written then."""
    slow = Slow(of)
    slow.control(5)
    slow.asks = True
    slow.control(60)
    assert slow.node.fact(DRIVES_JETS)
    refused = b"\x7f\x27\x22"
    answers = list[bytes]()
    while not answers or answers[-1] != refused:
        slow.ask(b"\x10\x03")
        answers.append(slow.unlock(3)[-1][1])
        # Nor is it left while nobody asks for anything.
        slow.look()
        assert len(answers) < 40
    writes = slow.node.fact(WRITES)
    assert answers[:-1] == (len(answers) - 1) * [b"\x67\x04"] and len(answers) > 5
    assert slow.unlock(3)[-1][1] == refused and slow.node.fact(WRITES) == writes
    slow.asks = False
    slow.control(60)
    slow.ask(b"\x10\x03")
    assert slow.unlock(3)[-1][1] == b"\x67\x04"


def reset_behind_jets(of: World) -> None:
    """A reset waits for a period that shuts the jets if control began behind its request."""
    slow = Slow(of)
    slow.control(60)
    slow.ask(b"\x10\x02")
    slow.end.send(b"\x11\x01")
    assert slow.look() == [b"\x51\x01"]
    slow.asks = True
    slow.control(1)
    assert slow.node.fact(DRIVES_JETS) and not slow.node.fact(WANTS_RESET)
    slow.control(1)
    assert slow.node.fact(WANTS_RESET) and not slow.node.fact(DRIVES_JETS)


STORIES: Final = (erased_quickly, erased_beside, with_few_places, beside_jets, reset_behind_jets)
