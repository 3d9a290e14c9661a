"""What must hold after every request, whatever it was: judged by what is in the memory and what the tester sent.

The witness knows the secret and every image that may run. It believes nothing that the server says of itself, except
for which level it holds unlocked.
"""

import hashlib
from collections import Counter
from typing import Final

from can_bridge.flashing import state
from can_bridge.flashing.access_level import Level
from can_bridge.flashing.backing import Kind, Slot
from can_bridge.flashing.boot import Boot
from can_bridge.flashing.state import Phase, StoreState
from can_bridge.uds.services import Nrc, Session
from contract.errors import KeyFileError
from contract.release import key_list, signing
from tests.can_bridge.flashing.plain_backing import PlainBacking
from tests.can_bridge.flashing.releases import ROOT
from tests.can_bridge.flashing.store_ecu import KEY, StoreEcu
from tests.proofs.flash.fuzz_images import pool

DELAY_NS: Final = 10_000_000_000
MAX_WRONG: Final = 3
"""Wrong keys in a row after which there is a delay before each attempt."""
_SEED_LENGTH: Final = 16
_TRUSTED: Final = frozenset({Phase.CHECKED, Phase.TRIAL, Phase.CONFIRMED})
_BEFORE: Final = {
    Phase.CHECKED: {Phase.FILLING, Phase.BAD},
    Phase.TRIAL: {Phase.CHECKED},
    Phase.CONFIRMED: {Phase.TRIAL},
}
"""From which phases each of those is reached."""


class Witness:
    """Watches one ECU, and the memory that it has.

    Args:
        found: counts violations, by kind.
        steps: counts what is reached: phases, confirmations, boots.
    """

    def __init__(self, ecu: StoreEcu, backing: PlainBacking, found: Counter[str], steps: Counter[str]) -> None:
        self._ecu, self._backing, self.found, self.steps = ecu, backing, found, steps
        self._seeds: dict[Level, bytes] = {}
        self._offered: Level | None = None
        self._allowed: Level | None = None
        self._wrong = dict.fromkeys(Level, 0)
        self._closed_until_ns = dict.fromkeys(Level, 0)
        self._record = backing.memory.records[Kind.STATE]
        self._state = state.decode(self._record)
        self._keys = backing.memory.records[Kind.KEYS]

    def before(self, request: bytes) -> None:
        """The tester is about to send it."""
        level = _level_of_answer(request)
        if level in self._seeds and request[2:] == KEY.answer(level, self._seeds[level]):
            self._offered = level

    def after(self, now_ns: int, request: bytes, answers: list[bytes]) -> None:
        """The answers came."""
        for answer in answers:
            if answer[0] == 0x67 and len(answer) == 2 + _SEED_LENGTH:
                self._seeds[Level(answer[1])] = answer[2:]
        if request[:1] == b"\x10" and not any(answer[:2] == b"\x7f\x10" for answer in answers):
            self._lock()
        self._judge_attempt(now_ns, request, answers)
        self.look()
        self._offered = None

    def look(self) -> None:
        """Compare server and memory with what may be."""
        server = self._ecu.server
        if server.session == Session.DEFAULT:
            self._lock()
        if server.unlocked != self._allowed:
            if server.unlocked not in (None, self._offered):
                self.found["unlocked_without_key"] += 1
            # Counted once, not with every request that follows.
            self._allowed = server.unlocked
        kept = self._backing.memory.records
        if kept[Kind.KEYS] != self._keys:
            self._judge_keys(kept[Kind.KEYS])
        if kept[Kind.STATE] != self._record:
            self._judge_state(kept[Kind.STATE])

    def powered_on(self, now_ns: int, boot: Boot) -> None:
        """The ECU booted."""
        self._lock()
        for level, wrong in self._wrong.items():
            if wrong >= MAX_WRONG:
                self._closed_until_ns[level] = now_ns + DELAY_NS
        self.look()
        self.steps[f"boot: {boot.reason.name}"] += 1
        if boot.bundle is None or boot.slot is None:
            self.found["releases_lost"] += 1
        elif not self._may_run(self._state, boot.slot, least=self._state.least_security_version):
            self.found["activated_unsigned"] += 1

    def _lock(self) -> None:
        self._allowed = None
        self._seeds.clear()

    def _judge_attempt(self, now_ns: int, request: bytes, answers: list[bytes]) -> None:
        level = _level_of_answer(request)
        if level is None or bytes([0x7F, 0x27, Nrc.BUSY_REPEAT_REQUEST]) in answers:
            return
        self._seeds.pop(level, None)
        last = answers[-1] if answers else b""
        is_wrong = last in (bytes([0x7F, 0x27, Nrc.INVALID_KEY]), bytes([0x7F, 0x27, Nrc.EXCEEDED_ATTEMPTS]))
        is_right = self._ecu.server.unlocked == level
        if not is_wrong and not is_right:
            return
        self.steps["right keys" if is_right else "wrong keys"] += 1
        if now_ns < self._closed_until_ns[level]:
            self.found["attempts_in_delay"] += 1
        self._wrong[level] = 0 if is_right else self._wrong[level] + 1
        if self._wrong[level] >= MAX_WRONG:
            self._closed_until_ns[level] = now_ns + DELAY_NS

    def _judge_keys(self, raw: bytes) -> None:
        try:
            taken = key_list.decode(raw, signing.public_key(ROOT))
            is_newer = taken.version > key_list.decode(self._keys, signing.public_key(ROOT)).version
        except KeyFileError:
            is_newer = False
        if not is_newer or raw not in pool().key_lists:
            self.found["key_lists_taken_wrongly"] += 1
        self.steps["key lists"] += 1
        self._keys = raw

    def _judge_state(self, record: bytes) -> None:
        before, now = self._state, state.decode(record)
        self._record, self._state = record, now
        for slot in Slot:
            phase = now.slots[slot].phase
            if phase not in _TRUSTED:
                continue
            is_new = phase != before.slots[slot].phase
            if is_new:
                self.steps[phase.name] += 1
            out_of_order = is_new and before.slots[slot].phase not in _BEFORE[phase]
            if out_of_order or not self._may_run(now, slot, least=before.least_security_version if is_new else 0):
                self.found["activated_unsigned"] += 1
        if now.active != before.active and now.active is not None:
            self.steps["active slot changed"] += 1
            if now.slots[now.active].phase != Phase.CONFIRMED:
                self.found["activated_unsigned"] += 1
        if now.active is None or now.least_security_version < before.least_security_version:
            self.found["releases_lost"] += 1

    def _may_run(self, of: StoreState, slot: Slot, least: int = 0) -> bool:
        """Whether the bytes in a slot are an image signed by a key that may sign, and not too old."""
        content = self._backing.content(slot)[: of.slots[slot].length]
        origin = pool().origins.get(hashlib.sha256(content).digest())
        if origin is None or origin.security_version < least:
            return False
        # One that was confirmed before its key was revoked stays until the boot that refuses it.
        if least == 0:
            return True
        return origin.signer in key_list.decode(self._keys, signing.public_key(ROOT)).keys


def _level_of_answer(request: bytes) -> Level | None:
    """The level that a request tries to unlock."""
    if len(request) != 2 + _SEED_LENGTH or request[0] != 0x27:
        return None
    number = (request[1] & 0x7F) - 1
    return Level(number) if number in frozenset(Level) else None
