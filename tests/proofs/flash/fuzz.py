"""Hostile requests to the UDS server over a real store: what must never happen, and what was reached meanwhile."""

from collections import Counter, deque
from dataclasses import dataclass
from random import Random
from typing import Final

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
VIOLATIONS: Final = (
    *("exceptions", "unlocked_without_key", "attempts_in_delay", "activated_unsigned", "key_lists_taken_wrongly"),
    *("releases_lost", "stuck"),
)
"""Figures that must be 0."""


@dataclass(frozen=True, kw_only=True)
class FuzzFigures:
    """What was found, and how far the requests came.

    Attributes:
        requests: sent.
        exceptions: that left the server.
        unlocked_without_key: a level was unlocked, and nobody had sent the key to the last seed.
        attempts_in_delay: keys that were judged though the delay after too many wrong ones was not over.
        activated_unsigned: an image became checked, on trial, confirmed or booted that is not signed by a key of the
            list, is older than allowed, or did so out of order.
        key_lists_taken_wrongly: a key list was taken that the root key did not sign, or an older one.
        releases_lost: an ECU had no release to boot, or none confirmed.
        stuck: work that did not end.
        by_service: answers, by service and code in hex; `positive`, `none` and `pending` are no codes.
        steps: how often an image came to a phase, a key was right, an ECU booted, and why.
        failures: the first exceptions.
    """

    requests: int
    exceptions: int
    unlocked_without_key: int
    attempts_in_delay: int
    activated_unsigned: int
    key_lists_taken_wrongly: int
    releases_lost: int
    stuck: int
    by_service: dict[str, dict[str, int]]
    steps: dict[str, int]
    failures: list[str]


class _Fuzzing:
    """One ECU after the other, and a tester."""

    def __init__(self, seed: int) -> None:
        self._rng = Random(seed)
        self._seed = seed
        self.sent = 0
        self._now_ns = 0
        self._answers: Counter[tuple[str, str]] = Counter()
        self._found: Counter[str] = Counter()
        self._steps: Counter[str] = Counter()
        self._failures: list[str] = []
        self._recent: deque[bytes]
        self._last_seed: bytes | None
        self._is_delayed: bool
        self._on_this_ecu: int
        self._fresh_ecu()

    def plan(self, most: int) -> None:
        """One plan with its noise, of so many requests at most."""
        rng = self._rng
        if self._on_this_ecu >= PER_ECU:
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
            answer = self._send(request)
            try:
                request = plan.send(answer)
            except StopIteration:
                request = None

    @property
    def has_found(self) -> bool:
        """Whether anything that must not happen did."""
        return self._found.total() + self._witness.found.total() > 0

    def figures(self) -> FuzzFigures:
        self._collect()
        by_service: dict[str, dict[str, int]] = {}
        for (service, code), count in sorted(self._answers.items()):
            by_service.setdefault(service, {})[code] = count
        violations = {name: self._found[name] for name in VIOLATIONS}
        steps = dict(sorted(self._steps.items()))
        return FuzzFigures(
            requests=self.sent, by_service=by_service, steps=steps, failures=self._failures[:10], **violations
        )

    def _fresh_ecu(self) -> None:
        if self.sent:
            self._collect()
        backing = provisioned()
        self._ecu = StoreEcu(lambda: backing, self._rng.randbytes)
        self._witness = Witness(self._ecu, backing)
        self._recent = deque([b"\x10\x02"], maxlen=_REMEMBERED)
        self._last_seed = None
        self._is_delayed = False
        self._on_this_ecu = 0

    def _collect(self) -> None:
        self._found += self._witness.found
        self._steps += self._witness.steps
        self._witness.found.clear()
        self._witness.steps.clear()

    def _send(self, request: bytes) -> bytes | None:
        """Time goes by, the request is sent, and its work goes on to the end, mostly."""
        rng = self._rng
        self.sent += 1
        self._on_this_ecu += 1
        self._recent.append(request)
        self._let_time_pass()
        self._witness.before(request)
        answers: list[bytes] = []
        try:
            answers = self._ecu.server.request(self._now_ns, request)
            self._witness.look()
            if rng.random() < 0.98:
                answers += self._finish_work()
        except Exception as error:  # noqa: BLE001 - what this looks for
            self._found["exceptions"] += 1
            self._failures.append(f"request {self.sent} of seed {self._seed}, {request[:40].hex()}: {error!r}")
        self._count(request, answers)
        self._witness.after(self._now_ns, request, answers)
        if self._ecu.is_reset or rng.random() < 0.0005:
            self._power_on()
        for answer in answers:
            if answer[0] == 0x67 and len(answer) == 18:
                self._last_seed = answer[2:]
            self._is_delayed |= answer in _DELAYED
        return answers[-1] if answers else None

    def _let_time_pass(self) -> None:
        draw = self._rng.random()
        if draw < 0.002:
            self._now_ns += self._rng.randrange(12_000) * MS
        else:
            self._now_ns += self._rng.randrange(10) * MS // 2

    def _finish_work(self) -> list[bytes]:
        answers: list[bytes] = []
        for _ in range(_MOST_TICKS):
            if not self._ecu.server.is_busy:
                return answers
            self._now_ns += self._rng.choice((1, 1, 1, 20)) * MS
            answers += self._ecu.server.tick(self._now_ns)
            self._witness.look()
        self._found["stuck"] += 1
        return answers

    def _power_on(self) -> None:
        self._witness.powered_on(self._now_ns, self._ecu.power_on())

    def _count(self, request: bytes, answers: list[bytes]) -> None:
        known = bool(request) and request[0] in frozenset(Service)
        service = f"0x{request[0]:02x}" if known else "others"
        if not answers:
            self._answers[service, "none"] += 1
        for answer in answers:
            if answer[0] != 0x7F:
                code = "positive"
            else:
                code = "pending" if answer[2] == Nrc.RESPONSE_PENDING else f"0x{answer[2]:02x}"
            self._answers[service, code] += 1


def fuzz(requests: int, seed: int, *, until_found: bool = False) -> FuzzFigures:
    """Send so many requests; the same ones for the same seed.

    Args:
        until_found: stop after the plan in which something was found.
    """
    fuzzing = _Fuzzing(seed)
    while fuzzing.sent < requests and not (until_found and fuzzing.has_found):
        fuzzing.plan(requests - fuzzing.sent)
    return fuzzing.figures()
