"""Hostile requests to the UDS server over a real store: what must never happen, and what was reached meanwhile."""

from collections import Counter, deque
from collections.abc import Collection
from random import Random
from typing import Final, NamedTuple

from can_bridge.uds.services import Nrc, Service
from tests.can_bridge.flashing.releases import provisioned
from tests.can_bridge.flashing.store_ecu import StoreEcu
from tests.proofs.flash.fuzz_requests import any_noise, any_plan
from tests.proofs.flash.fuzz_witness import DELAY_NS, Witness

MS: Final = 1_000_000
NOISE: Final = (0.0, 0.02, 0.1, 0.4, 1.0)
"""Shares of requests that are in no plan; one of them for each plan."""
PER_ECU: Final = 3000
"""Requests after which an ECU comes fresh from production: its key list and security version only rise."""
_REMEMBERED: Final = 40
"""Requests that may come again."""
_DELAYED: Final = tuple(
    bytes([0x7F, Service.SECURITY, code]) for code in (Nrc.EXCEEDED_ATTEMPTS, Nrc.DELAY_NOT_EXPIRED)
)
_MOST_TICKS: Final = 1000
VIOLATIONS: Final = {
    "exceptions": "that left the server",
    "unlocked_without_key": "a level was unlocked, and no one had sent the key to the last seed",
    "attempts_in_delay": "keys that were judged though the delay after too many wrong ones was not over",
    "activated_unsigned": "an image became checked, on trial, confirmed or booted that is not signed by a key of the "
    "list, is older than allowed, or did so out of order",
    "key_lists_taken_wrongly": "a key list was taken that the root key did not sign, or an older one",
    "releases_lost": "an ECU had no release to boot, or none confirmed",
    "stuck": "work that did not end",
}
"""Figures that must be 0."""


class FuzzFigures(NamedTuple):
    """What was found, and how far the requests came.

    Attributes:
        requests: sent.
        violations: how often each of `VIOLATIONS` occurred.
        by_service: answers, by service and code in hex; `positive`, `none` and `pending` are no codes.
        steps: how often an image came to a phase, a key was right, an ECU booted, and why.
        failures: the first exceptions.
    """

    requests: int
    violations: dict[str, int]
    by_service: dict[str, Counter[str]]
    steps: Counter[str]
    failures: list[str]


class _Fuzzing:
    """One ECU after the other, and a tester."""

    def __init__(self, seed: int) -> None:
        self._rng, self._seed, self._now_ns = Random(seed), seed, 0
        self.found: Counter[str] = Counter()
        self.figures = FuzzFigures(0, {}, {}, Counter(), [])
        self.sent = self._fresh_at = 0
        self._is_delayed = False
        self._fresh_ecu()

    def plan(self, most: int) -> None:
        """One plan with its noise, of so many requests at most."""
        rng = self._rng
        if self.sent - self._fresh_at >= PER_ECU:
            self._fresh_ecu()
        if self._is_delayed and rng.random() < 0.8:
            # After wrong keys a tester that has the right one waits.
            self._now_ns += DELAY_NS
        self._is_delayed = False
        self._ecu.is_wanted = rng.random() < 0.05
        noise, plan = rng.choice(NOISE), any_plan(rng)
        request: bytes | None = next(plan)
        while request is not None and most > 0:
            most -= 1
            if rng.random() < noise:
                self._send(any_noise(rng, self._recent, self._last_seed))
                if noise == 1.0 and rng.random() < 0.02:
                    return
                continue
            try:
                request = plan.send(self._send(request))
            except StopIteration:
                request = None

    def _fresh_ecu(self) -> None:
        backing = provisioned()
        self._ecu = StoreEcu(lambda: backing, self._rng.randbytes)
        self._witness = Witness(self._ecu, backing, self.found, self.figures.steps)
        self._recent = deque([b"\x10\x02"], maxlen=_REMEMBERED)
        self._last_seed: bytes | None = None
        self._is_delayed, self._fresh_at = False, self.sent

    def _send(self, request: bytes) -> bytes | None:
        """Time goes by, the request is sent, and its work goes on to the end, mostly."""
        rng = self._rng
        self.sent += 1
        self._recent.append(request)
        self._now_ns += rng.randrange(12_000) * MS if rng.random() < 0.002 else rng.randrange(10) * MS // 2
        self._witness.before(request)
        answers: list[bytes] = []
        try:
            answers = self._ecu.server.request(self._now_ns, request)
            self._witness.look()
            if rng.random() < 0.98:
                answers += self._finish_work()
        except Exception as error:  # noqa: BLE001 - what this looks for
            self.found["exceptions"] += 1
            text = f"request {self.sent} of seed {self._seed}, {request[:40].hex()}: {error!r}"
            self.figures.failures.append(text)
        self._count(request, answers)
        self._witness.after(self._now_ns, request, answers)
        if self._ecu.is_reset or rng.random() < 0.0005:
            self._witness.powered_on(self._now_ns, self._ecu.power_on())
        for answer in answers:
            if answer[0] == 0x67 and len(answer) == 18:
                self._last_seed = answer[2:]
            self._is_delayed |= answer in _DELAYED
        return answers[-1] if answers else None

    def _finish_work(self) -> list[bytes]:
        answers: list[bytes] = []
        for _ in range(_MOST_TICKS):
            if not self._ecu.server.is_busy:
                return answers
            self._now_ns += self._rng.choice((1, 1, 1, 20)) * MS
            answers += self._ecu.server.tick(self._now_ns)
            self._witness.look()
        self.found["stuck"] += 1
        return answers

    def _count(self, request: bytes, answers: list[bytes]) -> None:
        known = bool(request) and request[0] in frozenset(Service)
        count = self.figures.by_service.setdefault(f"0x{request[0]:02x}" if known else "others", Counter())
        count["none"] += not answers
        for answer in answers:
            code = "pending" if answer[2:3] == bytes([Nrc.RESPONSE_PENDING]) else f"0x{answer[2:3].hex()}"
            count[code if answer[0] == 0x7F else "positive"] += 1


def fuzz(requests: int, seed: int, *, until: Collection[str] = ()) -> FuzzFigures:
    """Send so many requests; the same ones for the same seed.

    Args:
        until: violations after which it stops.
    """
    fuzzing = _Fuzzing(seed)
    while fuzzing.sent < requests and not any(fuzzing.found[name] for name in until):
        fuzzing.plan(requests - fuzzing.sent)
    violations = {name: fuzzing.found[name] for name in VIOLATIONS}
    return fuzzing.figures._replace(requests=fuzzing.sent, violations=violations)
