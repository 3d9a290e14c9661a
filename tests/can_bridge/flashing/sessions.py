"""A transfer as the store makes it, on any backing, and what must hold of the backing after each loss of supply.

The session knows nothing but what the backing gives back, as after a reset: it goes on with an interrupted transfer, or
begins anew. `Witness` stands outside, knows all that was asked for, and judges what is found.
"""

import json
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from random import Random

from can_bridge.flashing.backing import Backing, Kind, Slot
from tests.can_bridge.flashing.medium import PowerCut

CHUNK = 70
"""Bytes of a block; no multiple of a word."""


def image_of(number: int, length: int) -> bytes:
    """Bytes that tell images, and places in them, apart."""
    return Random(number).randbytes(length)


@dataclass
class Witness:
    """What may be found after a cut.

    Attributes:
        lengths: of the images by number.
        records: that were kept.
        pending: the one that was being kept.
    """

    lengths: Mapping[int, int]
    records: dict[Kind, bytes] = field(default_factory=dict)
    pending: tuple[Kind, bytes] | None = None

    def keep(self, backing: Backing, kind: Kind, record: bytes) -> None:
        self.pending = kind, record
        backing.keep(kind, record)
        self.records[kind] = record
        self.pending = None

    def judge(self, backing: Backing) -> None:
        """After power-on: records are old or new, checkpointed bytes are there."""
        found = dict(backing.records())
        if self.pending is not None and found.get(self.pending[0]) == self.pending[1]:
            self.records[self.pending[0]] = self.pending[1]
        self.pending = None
        assert found == self.records
        for name, (number, received) in state_of(backing).items():
            image = image_of(number, self.lengths[number])
            assert backing.read(Slot[name], 0, received) == image[:received], (name, number, received)


def state_of(backing: Backing) -> dict[str, tuple[int, int]]:
    """Of each slot, the image's number and its bytes that are there."""
    return {name: (number, got) for name, (number, got) in json.loads(backing.records().get(Kind.STATE, b"{}")).items()}


def transfer(backing: Backing, witness: Witness, slot: Slot, number: int) -> None:
    """Bring an image into a slot, from wherever an earlier call was interrupted."""
    image = image_of(number, witness.lengths[number])
    state = state_of(backing)
    if state.get(slot.name, (None, 0))[0] == number:
        received = state[slot.name][1]
        if received == len(image):
            return
        backing.begin_again(slot, received)
    else:
        received = 0
        witness.keep(backing, Kind.STATE, _encode(state | {slot.name: (number, 0)}))
        for _ in backing.clear(slot):
            pass
    while received < len(image):
        backing.append(slot, image[received : received + CHUNK])
        received = min(received + CHUNK, len(image))
        witness.keep(backing, Kind.STATE, _encode(state | {slot.name: (number, received)}))
        if received % (3 * CHUNK) == 0:
            witness.keep(backing, Kind.KEYS, image[:received][-90:])


def run(power_on: Callable[[], Backing], witness: Witness, plan: list[tuple[Slot, int]]) -> bool:
    """Power on, judge, and work through the plan from wherever it stands; whether that ended without a cut."""
    backing = power_on()
    witness.judge(backing)
    try:
        for slot, number in plan:
            if (slot, number) not in plan[: _done(backing, plan)]:
                transfer(backing, witness, slot, number)
                witness.keep(backing, Kind.CALIBRATION, bytes([number]))
    except PowerCut:
        return False
    witness.judge(power_on())
    return True


def _done(backing: Backing, plan: list[tuple[Slot, int]]) -> int:
    """Images of the plan that were brought in wholly: the calibration's record counts them."""
    kept = backing.records().get(Kind.CALIBRATION)
    return 0 if kept is None else [number for _, number in plan].index(kept[0]) + 1


def _encode(state: Mapping[str, tuple[int, int]]) -> bytes:
    return json.dumps(state, sort_keys=True).encode()
