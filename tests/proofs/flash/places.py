"""Memories that branch before any of their operations: in the branch the operation is torn, and the supply gone.

So the sequence up to a cut runs once, however many cuts there are: whatever outlives a loss of supply is in the memory.
"""

from collections.abc import Callable
from copy import deepcopy
from pathlib import Path
from typing import Final, Protocol, Self

from benchmarks.flash.lossy_files import LossyFiles
from can_bridge.flashing.backing import Backing
from can_bridge.flashing.flash_memory.flash_backing import FlashBacking
from can_bridge.flashing.flash_memory.simulated_flash import SimulatedFlash
from can_bridge.flashing.folder_backing import FolderBacking
from can_bridge.flashing.medium import PowerCut

SECTORS: Final = 32
SECTOR_SIZE: Final = 16 * 1024
"""Smaller than those of most controllers: more erasures, more images across sectors, more moves of the log."""
CAPACITY: Final = 256 * 1024

OnCut = Callable[[int, "Place"], None]
"""Called with an operation's number and the memory as the cut in it leaves it."""


class Place(Protocol):
    """A memory."""

    @property
    def operations(self) -> int:
        """So far."""
        ...

    def backing(self) -> Backing:
        """Open it, after power-on."""
        ...

    def branch(self, at: Callable[[int], bool], on_cut: OnCut | None) -> None:
        """From now on, branch before every operation whose number `at` picks; None: no more."""
        ...

    def twin(self) -> Self:
        """A copy that goes its own way, powered, without branches."""
        ...


class FlashPlace(SimulatedFlash):
    """A flash memory of the proof."""

    def __init__(self, seed: int) -> None:
        super().__init__(SECTORS, SECTOR_SIZE, seed=seed)
        self._at: Callable[[int], bool] = lambda number: False
        self._on_cut: OnCut | None = None

    def backing(self) -> Backing:
        return FlashBacking(self)

    def branch(self, at: Callable[[int], bool], on_cut: OnCut | None) -> None:
        self._at, self._on_cut = at, on_cut

    def twin(self) -> Self:
        made = self.copy()
        made.power_on()
        made._on_cut = None
        return made

    def erase(self, sector: int) -> None:
        self._branch(lambda torn: torn.erase(sector))
        super().erase(sector)

    def _program_word(self, address: int, data: bytes) -> None:
        self._branch(lambda torn: torn._program_word(address, data))
        super()._program_word(address, data)

    def _branch(self, tear: Callable[[Self], None]) -> None:
        if self._on_cut is not None and self._at(self.operations):
            torn = self.twin()
            torn.power_on(cut_at=torn.operations)
            _cut(lambda: tear(torn))
            torn.power_on()
            self._on_cut(self.operations, torn)


class FolderPlace(LossyFiles):
    """A folder of the proof."""

    def __init__(self, seed: int) -> None:
        super().__init__(seed)
        self._at: Callable[[int], bool] = lambda number: False
        self._on_cut: OnCut | None = None

    @property
    def operations(self) -> int:
        return self.calls

    def backing(self) -> Backing:
        return FolderBacking(Path("unused"), files=self, capacity=CAPACITY)

    def branch(self, at: Callable[[int], bool], on_cut: OnCut | None) -> None:
        self._at, self._on_cut = at, on_cut

    def twin(self) -> Self:
        made = object.__new__(type(self))
        names, synced = deepcopy((self._names, self._synced_names))
        made.__dict__.update({**self.__dict__, "_names": names, "_synced_names": synced, "cut_at": None})
        made._on_cut = None
        return made

    def append(self, name: str, data: bytes) -> None:
        self._branch(lambda torn: torn.append(name, data))
        super().append(name, data)

    def replace(self, name: str, data: bytes) -> None:
        self._branch(lambda torn: torn.replace(name, data))
        super().replace(name, data)

    def truncate(self, name: str, length: int) -> None:
        self._branch(lambda torn: torn.truncate(name, length))
        super().truncate(name, length)

    def rename(self, old: str, new: str) -> None:
        self._branch(lambda torn: torn.rename(old, new))
        super().rename(old, new)

    def sync(self, name: str) -> None:
        self._branch(lambda torn: torn.sync(name))
        super().sync(name)

    def sync_folder(self) -> None:
        self._branch(lambda torn: torn.sync_folder())
        super().sync_folder()

    def _branch(self, tear: Callable[[Self], None]) -> None:
        if self._on_cut is not None and self._at(self.calls):
            torn = self.twin()
            torn.power_on(cut_at=torn.calls)
            _cut(lambda: tear(torn))
            torn.power_on()
            self._on_cut(self.calls, torn)


def _cut(operation: Callable[[], None]) -> None:
    try:
        operation()
    except PowerCut:
        return
    raise AssertionError("the supply was not cut")
