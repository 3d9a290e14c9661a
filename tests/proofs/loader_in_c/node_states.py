"""Requests of every kind in every state of diagnosis, to both ECUs at once.

A tester leads both into a state: sessions, locked and unlocked, wrong keys and the time after them, a transfer at each
of its stages, a release refused, activated, on trial, given up, the jets running, the memory failing. Then it asks for
what there is and is not, mostly for what leaves the state as it is.
"""

import tempfile
from collections import Counter
from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path
from random import Random
from typing import Annotated, Any, Final

import typer

from can_bridge.flashing.state import Level, SlotPhase
from can_bridge.uds.services import Did, Routine, Service
from contract.errors import StillwakeError
from tests.proofs.command_line import JsonFile, Processes, Seed, in_parts, report
from tests.proofs.loader_in_c import node_plans as plans
from tests.proofs.loader_in_c.node_library import GEOMETRY, Library, build, sources
from tests.proofs.loader_in_c.node_program import Program
from tests.proofs.loader_in_c.node_twin import CONFIGS, MS, OTHERS, Twins, World, as_in_c, world

Met = Counter[tuple[str, int]]  # requests by the state that each found, and by service
REQUESTS: Final = 2_000  # of one vehicle
_VISIT: Final = 60  # requests until another state is led to
_MOST_TICKS: Final = 400
_KEEPS: Final = (Service.READ, Service.REPORT_FAULTS, Service.SECURITY, Service.WRITE, Service.ROUTINE)
"""Services that mostly leave a session as it is."""
_BAD: Final = (
    "unsigned", "stranger's", "altered", "old", "of another build", "of another vehicle", "that does not open",
)  # fmt: skip


def _announced(rng: Random, of: World, most: int) -> plans.Plan:
    """A transfer after so many blocks; 0: after the request for it."""
    image = of.images[rng.choice(("newest", "for this hardware"))]
    yield from plans.unlocking(Level.PROGRAMMING)
    yield from plans.blocks(image, (yield from plans.announced(image)), 2000, most)


def _refused(rng: Random, of: World) -> plans.Plan:
    image = of.images[rng.choice(_BAD)]
    yield from plans.unlocking(Level.PROGRAMMING)
    yield from plans.blocks(image, (yield from plans.announced(image)), 4000)
    yield from plans.each(b"\x37", plans.routine(Routine.CHECK))


def _wrong_keys(level: int, times: int) -> plans.Plan:
    yield bytes([0x10, 2 if level == 1 else 3])
    for _ in range(times):
        yield from plans.each(bytes([0x27, level]), bytes([0x27, level + 1]) + bytes(15) + b"\1")


def _then(plan: plans.Plan, *last: Any) -> plans.Plan:
    yield from plan
    yield from plans.each(*last)


_JETS: Final[tuple[plans.Step, ...]] = (lambda own: own.control(12, False), lambda own: own.control(10, True))
LEADS: Final[Mapping[str, Callable[[Random, World], plans.Plan]]] = {
    "default session": lambda rng, of: plans.each(b"\x10\x01"),
    "extended session": lambda rng, of: plans.each(b"\x10\x03"),
    "programming session": lambda rng, of: plans.each(b"\x10\x02"),
    "a seed is out": lambda rng, of: plans.each(*rng.choice(((b"\x10\x02", b"\x27\x01"), (b"\x10\x03", b"\x27\x03")))),
    "programming unlocked": lambda rng, of: plans.unlocking(Level.PROGRAMMING),
    "calibration unlocked": lambda rng, of: plans.unlocking(Level.CALIBRATION),
    "a wrong key": lambda rng, of: _wrong_keys(rng.choice((1, 3)), rng.choice((1, 2))),
    "time after wrong keys": lambda rng, of: _wrong_keys(rng.choice((1, 3)), 4),
    "a transfer asked for": lambda rng, of: _announced(rng, of, 0),
    "a transfer under way": lambda rng, of: _announced(rng, of, rng.choice((1, 2))),
    "a transfer left": lambda rng, of: _then(_announced(rng, of, 2), b"\x10\x03"),
    "an image refused": _refused,
    "an image flashed, or not": plans.flashing,
    "an image checked": lambda rng, of: plans.story(rng, of, 1),
    "an image activated": lambda rng, of: plans.story(rng, of, 2),
    "on trial": lambda rng, of: _then(plans.story(rng, of, 3), *([b"\x10\x02"] * rng.randrange(2))),
    "tested, confirmed, or back": lambda rng, of: plans.story(rng, of, 4),
    "faults not recorded": lambda rng, of: plans.each(b"\x10\x03", b"\x85\x02"),
    "silent": lambda rng, of: plans.each(b"\x10\x03", b"\x28\x01\x01"),
    "the jets run": lambda rng, of: plans.each(*_JETS, b"\x10\x03"),
    "the jets run, unlocked": lambda rng, of: _then(plans.unlocking(Level.CALIBRATION), *_JETS),
    "control asked for": lambda rng, of: plans.each(lambda program: program.control(3, True), b"\x10\x03"),
    "the memory fails": lambda rng, of: _then(plans.unlocking(Level.PROGRAMMING), lambda own: own.twins.fail(1)),
}  # fmt: skip


def _grid(rng: Random) -> bytes:
    """A request by its parts: a service, a sub-function or identifier, a length about the right one."""
    service = rng.choice(_KEEPS) if rng.random() < 0.7 else rng.choice((*Service, rng.randrange(256)))
    if service in (Service.READ, Service.WRITE):
        body = rng.choice(list(Did)).to_bytes(2, "big")
    elif service == Service.ROUTINE:
        harmless = (Routine.PRECONDITIONS, Routine.SELF_TEST, Routine.CHECK)
        number = rng.choice(harmless if rng.random() < 0.6 else tuple(Routine))
        body = bytes([rng.choice((1, 1, 1, 1, 0x81, 2, 3, 0))]) + number.to_bytes(2, "big")
    else:
        body = bytes([rng.choice((0, 1, 2, 3, 4, 6, 10, 0x81, 0x82, rng.randrange(256)))])
    length = rng.choice((0, 0, 0, 1, 1, 2, 3, 4, 8, 16, 24, 28, 36))
    head = bytes([service]) + body[: rng.choice((9, 9, 9, 9, 1, 0))]
    return head + rng.choice((bytes(length), rng.randbytes(length)))


class Prober(Program):
    """A tester who is answered at once."""

    def __init__(self, of: World, seed: str) -> None:
        super().__init__(of, seed, trouble=0.0)
        self.met = Met()
        self._own = Random(f"{seed} probes")

    def visit(self, requests: int, stay: int) -> Twins:
        """So many requests, from one state to the next after `stay` of them."""
        rng = self._own
        while self.requests < requests and not self.twins.differences:
            self.twins.fail(0)
            self.follow(rng.choice(list(LEADS.values()))(rng, self._of), 2**30)
            for _ in range(min(stay, requests - self.requests)):
                is_from_parts = rng.random() < 0.6
                self._probe(_grid(rng) if is_from_parts else plans.any_noise(rng, self.sent[-20:], self._seed) or b"\0")
                if rng.random() < 0.01:
                    self.wait(rng.choice((2600, 5001, 11_000)) * MS)
        return self.twins

    def _probe(self, request: bytes) -> None:
        """A request, and what follows it until nothing is under way."""
        twins = self.twins
        self.met[self._state(), request[0]] += 1
        self.requests += 1
        self._tester.send(request[:4095])
        for tick in range(_MOST_TICKS):
            frames = self._tester.poll(twins.now_ns)
            heard = twins.service(frames)
            for frame in heard:
                self._tester.receive(twins.now_ns, frame)
            for answer in self._tester.take():
                self._count(answer)
                if answer[0] == 0x51:
                    self.control(3, None)
            self.wait(MS)
            if twins.differences or (tick and not frames and not heard and not twins.python.is_busy):
                break
        if twins.now_ns >= twins.due_ns:
            twins.due_ns = twins.now_ns + 20 * MS
            twins.control(self._own.random() < 0.5 if twins.python.state.fail_safe.mode.drives_jets else None)

    def _state(self) -> str:
        """Session, access, the slots' phases, what is received, and whether the jets run, of the Python ECU."""
        python = self.twins.python
        access, store = python.cycle.access, python.cycle.store
        locked = "locked" if access.unlocked is None else access.unlocked.name.lower()
        phases = "/".join(SlotPhase(slot.phase).name.lower() for slot in store.state.slots)
        attempts = "wrong keys" if max(access.attempts.values()) > 2 else ""
        received = "" if store.received is None else "transfer"
        jets = "jets" if python.state.fail_safe.mode.drives_jets else ""
        parts = (access.session.name.lower(), locked, phases, received, attempts, jets, self.twins.fails and "failing")
        return ", ".join(str(part) for part in parts if part)


def visited(of: World, seed: str, requests: int, stay: int = _VISIT) -> tuple[Twins, Met]:
    """Both ECUs after so many requests, those that lead into states among them; which others came in which state."""
    with as_in_c(of):
        prober = Prober(of, seed)
        return prober.visit(requests, stay), prober.met


def _asked(kind: str, library: Path, seed: int, part: range) -> tuple[list[str], Met, Counter[str]]:
    """What differed, which requests came in which state, and how often answers of each kind came."""
    of = world(kind, Library(sources((CONFIGS | OTHERS)[kind]), library))
    twins, met = visited(of, f"{seed} {part.start}", len(part))
    return [f"{kind} {seed} {part.start}: {text}" for text in twins.differences], met, twins.seen


def main(
    json_file: JsonFile = None,
    seed: Seed = 0,
    processes: Processes = 2,
    requests: Annotated[int, typer.Option(help="Requests to both ECUs, shared among the builds.", min=4)] = 1_000_000,
) -> None:
    """Send requests of all kinds to both ECUs in every state of diagnosis; the answers must be alike."""
    differences, met, seen = list[str](), Met(), Counter[str]()
    kinds = CONFIGS | OTHERS
    with tempfile.TemporaryDirectory() as name:
        for kind, config in kinds.items():
            folder = Path(name, kind.replace(" ", "_"))
            library = build(sources(config), folder, "node.so", ("-O1", *GEOMETRY))
            work = partial(_asked, kind, library, seed)
            for found, in_states, answers in in_parts(work, requests // len(kinds), REQUESTS, processes, kind):
                differences += found
                met += in_states
                seen += answers
    figures = {
        "requests": requests // len(kinds) * len(kinds), "in_states": met.total(),
        "builds": len(kinds), "mismatches": len(differences),
        "states": len({state for state, _ in met}), "services_in_states": len(met), "kinds_of_answers": len(seen),
        "first_differences": differences[:10],
    }  # fmt: skip
    report(json_file, "requests in all states", figures, packages=("stillwake",), seed=seed, kinds=list(kinds))
    if differences:
        raise StillwakeError(f"{len(differences)} differ: {differences[0]}")
