"""Random testers against both ECUs: sound sequences, garbage, odd times, lost and altered frames."""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from random import Random
from typing import Final

from can_bridge.isotp import control_info
from can_bridge.isotp.endpoint import Endpoint
from can_bridge.wire.frame import CLASSIC_LENGTHS, FD_LENGTHS, Frame
from contract.config.diagnosis import CanId
from ecu.flashable.links import isotp_settings
from tests.proofs.loader_in_c.node_plans import Plan, any_noise, any_of
from tests.proofs.loader_in_c.node_twin import MS, Twins, World, as_in_c, frame_to
from tests.proofs.loader_in_c.xcp_tool import XcpTool

_MOST_TICKS: Final = 1500  # without an answer, after which a tester goes on
_STEPS_NS: Final = (MS // 5, MS, MS, MS, 2 * MS, 3 * MS)
_JUMPS_NS: Final = (30 * MS, 400 * MS, 1001 * MS, 2600 * MS, 5001 * MS, 11_000 * MS, -5 * MS)

_CONTROL: Final = (0x00, 0x02, 0x10, 0x11, 0x20, 0x21, 0x30, 0x31, 0x32, 0x33)


class Program:
    """One tester, one vehicle, one seed. `trouble` is the share of frames and times that are wrong. If `calm`, the
    tester is quick, the vehicle never asks for control, and no release is from production. `sent`: plans' requests."""

    def __init__(self, of: World, seed: int | str, *, trouble: float = 0.02, calm: bool = False) -> None:
        self._rng = rng = Random(seed)
        self.twins = Twins(of, first=None if calm else rng.choice(("one", "one", "one", None)))
        self._asking = 0.0 if calm else 0.001
        self._of, self._trouble = of, trouble
        self._is_fd = of.config.bus.frames == "fd"
        self._ids, self._to_all, self._to_all_rng = of.config.bus.diagnosis, list[Frame](), Random(f"{seed} to all")
        self._tester = Endpoint(
            replace(
                isotp_settings(of.config.bus, is_tester=True),
                frame_length=rng.choice((8, 12, 64, 64, 64)) if self._is_fd else 8,
                block_size=0 if calm else rng.choice((0, 0, 1, 8)),
                separation_code=0 if calm else rng.choice((0, 0, 1, 0xF3, 0x80, 0xFF)),
            )
        )
        self._tool = XcpTool(of.config.bus, f"{seed} tool", share=0.0 if calm else 0.8)
        self._pace = rng.choice((1, 1, 1, 7))
        self._asks: bool | None = None
        self._seed: bytes | None = None
        self.requests, self.sent = 0, [b"\x3e\x00"]

    def run(self, requests: int) -> Twins:
        while self.requests < requests and not self.twins.differences:
            self.follow(any_of(self._rng, self._of), requests)
        return self.twins

    def follow(self, plan: Plan, requests: int) -> None:
        """One plan, while no more than so many were sent in all."""
        sent, rng = self.sent, self._rng
        answer: bytes | None = None
        while self.requests < requests and not self.twins.differences:
            try:
                step = plan.send(answer) if answer is not None else next(plan)
            except (StopIteration, TypeError):
                return
            if not isinstance(step, bytes):
                step(self)
                answer = None
                continue
            if rng.random() < 2 * self._trouble:
                self._ask(any_noise(rng, sent[-20:], self._seed) or b"\x00")
            if rng.random() < self._trouble:
                # The tester is gone for a while.
                self.wait(rng.choice(_JUMPS_NS))
            answer = self._ask(step)
            sent.append(step)

    def control(self, periods: int, asks: bool | None) -> None:
        """So many control periods, with or without pressures that ask for control."""
        for _ in range(periods):
            self.wait(20 * MS)
            self.twins.control(asks)
            self.twins.service([])
        self.twins.due_ns = self.twins.now_ns + 20 * MS

    def burst(self, *requests: bytes) -> None:
        """Requests of at most 7 bytes, in one call."""
        self.twins.service([self._frame(control_info.single(request)) for request in requests])

    def wait(self, by_ns: int) -> None:
        """Time passes, or goes back."""
        # A clock that goes back behind a reset would go back behind a power-on.
        self.twins.now_ns = max(MS, self.twins.reset_ns, self.twins.now_ns + by_ns)

    def _ask(self, request: bytes) -> bytes | None:
        """The last answer to a request; some are not waited for."""
        self.requests, rng = self.requests + 1, self._rng
        if self._ids.functional and len(request) < 8 and self._to_all_rng.random() < 0.1:
            self._to_all.append(self._frame(control_info.single(request), self._ids.functional))
        else:
            self._tester.send(request[:4095])
        patience = rng.choice((1, 30)) if rng.random() < self._trouble else _MOST_TICKS
        found: bytes | None = None
        for tick in range(patience):
            self._tick()
            for answer in self._tester.take():
                self._count(answer)
                if answer[0] != 0x7F or answer[2] != 0x78:
                    found = answer
                if answer[0] == 0x51 and rng.random() >= self._trouble:
                    self.control(4, None)
            if found is not None or self.twins.differences or (tick > 60 and not self.twins.python.is_busy):
                break
        return found

    def _count(self, answer: bytes) -> None:
        self.twins.seen[f"{answer[0]:02x} {answer[1:3].hex() if answer[0] == 0x7F else ''}".strip()] += 1
        if answer[:1] == b"\x67" and len(answer) == 18:
            self._seed = answer[2:]

    def _tick(self) -> None:
        twins, rng = self.twins, self._rng
        if rng.random() < self._asking:
            self._asks = rng.choice((None, False, False, True))
        if twins.now_ns >= twins.due_ns:
            twins.due_ns = max(twins.due_ns + 20 * MS, twins.now_ns - 20 * MS)
            twins.control(self._asks)
        to_all, self._to_all = self._to_all, []
        frames = to_all + list(self._troubled(self._tester.poll(twins.now_ns)))
        heard = twins.service(frames + ([] if twins.is_void else self._tool.frames(twins.now_ns)))
        self._tool.hear(heard)
        for frame in heard:
            if rng.random() >= self._trouble / 4:
                self._tester.receive(twins.now_ns, frame)
        step_ns = self._pace * rng.choice(_STEPS_NS)
        self.wait(step_ns if rng.random() >= self._trouble / 20 else rng.choice(_JUMPS_NS))

    def _troubled(self, frames: Sequence[Frame]) -> Iterator[Frame]:
        """Frames as they arrive, and some that no one sent."""
        rng = self._rng
        for frame in frames:
            kind = rng.choice(("lost", "twice", "altered", "shorter")) if rng.random() < self._trouble / 4 else ""
            if frame.data[0] == 0x30 and rng.random() < 10 * self._trouble:
                # Not yet.
                yield from rng.choice((1, 1, 99, 101)) * [self._frame(b"\x31" + frame.data[1:])]
            data = bytearray(frame.data)
            if kind == "altered":
                data[rng.randrange(len(data))] ^= 1 << rng.randrange(8)
            if kind == "shorter":
                data = data[: rng.choice(CLASSIC_LENGTHS)]
            if kind != "lost":
                yield self._frame(bytes(data))
            if kind == "twice":
                yield frame
        while rng.random() < self._trouble:
            lengths = FD_LENGTHS if self._is_fd else CLASSIC_LENGTHS
            data = bytearray(rng.randbytes(rng.choice(lengths)))
            if data and rng.random() < 0.8:
                # Control information of a kind that there is, and often a sound length.
                data[0] = rng.choice(_CONTROL) | data[0] & rng.choice((0, 15))
            if rng.random() < 0.1:
                # The beginning of a message that is too long, or states its length in another way.
                data[:8] = rng.choice((b"\x10\0\0\1\0\0\0\0", b"\x10\0\0\0\0\x40\0\0"))[: len(data)]
            number, is_extended = self._ids.request
            to = self._ids.request if rng.random() < 0.9 else CanId(rng.randrange(0x800), is_extended)
            if self._ids.functional and self._to_all_rng.random() < 0.3:
                to = self._ids.functional
            if rng.random() < 0.02:
                to = CanId(number & 0x7FF, not is_extended)
            yield self._frame(bytes(data), to)

    def _frame(self, data: bytes, to: CanId | None = None) -> Frame:
        return frame_to(self._of.config.bus, data, to, self.twins.now_ns)


def play(of: World, seed: int, *, drawn_by: str = "") -> Twins:
    """Both ECUs after a program of 60 requests, with more trouble from one seed to the next, and then little again."""
    drawn, trouble = f"{drawn_by} {seed}" if drawn_by else seed, (0.001, 0.02, 0.1)[seed % 3]
    with as_in_c(of):
        return Program(of, drawn, trouble=trouble).run(60)


def play_plan(of: World, plan: Plan) -> Twins:
    """Both ECUs after a plan, from no release on."""
    with as_in_c(of):
        testing = Program(of, 0, trouble=0.0, calm=True)
        testing.follow(plan, 1000)
        return testing.twins


def requests_of(of: World, seeds: range) -> Iterator[bytes]:
    """What testers ask of a Python ECU, in their order."""
    for seed in seeds:
        with as_in_c(of):
            testing = Program(of, seed, trouble=0.0)
            testing.run(60)
            yield from testing.sent
