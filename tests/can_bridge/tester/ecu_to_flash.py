"""An ECU with the real server, services and store, over a memory that a test can watch and disturb."""

from collections.abc import Callable

from can_bridge.flashing.backing import Slot
from contract.release import bundle
from contract.release.container import image_of, read_files
from contract.release.signing import PublicKey
from contract.shipped import BUNDLE
from tests.can_bridge.flashing.plain_backing import PlainBacking
from tests.can_bridge.flashing.releases import RELEASE, damage, image, keys, name_of, provision
from tests.can_bridge.flashing.store_ecu import StoreEcu

SHIPPED = image_of(read_files(BUNDLE))
SHIPPED_BY = bundle.load(BUNDLE).signer or PublicKey(b"")


class WatchedBacking(PlainBacking):
    """Attributes: `written`, bytes of images; `on_written`, called with those of the slot after each block."""

    written = 0
    on_written: Callable[[int], None] = staticmethod(lambda received: None)

    def append(self, slot: Slot, data: bytes) -> None:
        super().append(slot, data)
        self.written += len(data)
        self.on_written(len(self.content(slot)))


class EcuToFlash(StoreEcu):
    """Release `old` is confirmed; keys that may sign are the tests' and that of the shipped release.

    Attributes:
        memory: outlives resets.
        spoils: whether the other slot is damaged before the next reset.
    """

    def __init__(self, first: bytes | None = image("old")) -> None:
        self.memory = provision(WatchedBacking(), first, keys=keys(1, RELEASE, SHIPPED_BY))
        self.memory.written = 0
        self.spoils = False
        super().__init__(lambda: self.memory)

    @property
    def runs(self) -> str | None:
        return name_of(self.boot)

    def reset(self) -> None:
        if self.spoils:
            damage(self.memory, Slot.B)
        super().reset()
