"""An ECU with the real server, services and store, over a memory that a test can watch and disturb."""

from contract.release import bundle
from contract.release.container import image_of, read_files
from contract.release.signing import PublicKey
from contract.shipped import BUNDLE
from tests.can_bridge.flashing.plain_backing import PlainBacking
from tests.can_bridge.flashing.releases import RELEASE, image, keys, name_of, provision
from tests.can_bridge.flashing.store_ecu import StoreEcu

SHIPPED = image_of(read_files(BUNDLE))
SHIPPED_BY = bundle.load(BUNDLE).signer or PublicKey(b"")


class EcuToFlash(StoreEcu):
    """Release `old` is confirmed; keys that may sign are the tests' and that of the shipped release. `memory` outlives
    resets."""

    def __init__(self, first: bytes | None = image("old")) -> None:
        self.memory = provision(PlainBacking(), first, keys=keys(1, RELEASE, SHIPPED_BY))
        self.memory.written = 0
        super().__init__(lambda: self.memory)

    @property
    def runs(self) -> str | None:
        return name_of(self.boot)
