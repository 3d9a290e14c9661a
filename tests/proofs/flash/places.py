"""Memories that branch before any of their operations: in the branch the operation is torn, and the supply gone.

So the sequence up to a cut runs once, however many cuts there are: whatever outlives a loss of supply is in the memory.
"""

from collections.abc import Callable
from copy import deepcopy
from pathlib import Path
from typing import Any, Final, Protocol, Self

from can_bridge.flashing.backing import Backing
from can_bridge.flashing.folder_backing import FolderBacking
from tests.can_bridge.flashing.lossy_files import LossyFiles
from tests.can_bridge.flashing.medium import PowerCut
from tests.proofs.flash.flash_memory.flash_backing import FlashBacking
from tests.proofs.flash.flash_memory.simulated_flash import SimulatedFlash

SECTORS: Final = 32
SECTOR_SIZE: Final = 16 * 1024
"""Smaller than those of most controllers: more erasures, more images across sectors, more moves of the log."""
CAPACITY: Final = 256 * 1024

OnCut = Callable[[int, "Place"], None]
"""Called with an operation's number and the memory as the cut in it leaves it."""


class Place(Protocol):
    """A memory; `operations` so far."""

    operations: int

    def backing(self) -> Backing:
        """Open it, after power-on."""
        ...

    def branch(self, at: Callable[[int], bool], on_cut: OnCut | None) -> None:
        """From now on, branch before every operation whose number `at` picks; None: no more."""
        ...

    def twin(self) -> Self:
        """A copy that goes its own way, powered, without branches."""
        ...


class _Branching:
    """What both memories have in common: the branch before an operation."""

    operations: int
    _at: Callable[[int], bool]
    _on_cut: OnCut | None = None

    def branch(self, at: Callable[[int], bool], on_cut: OnCut | None) -> None:
        self._at, self._on_cut = at, on_cut

    def before(self: Any, tear: Callable[[Any], None]) -> None:
        if self._on_cut is None or not self._at(self.operations):
            return
        torn = self.twin()
        torn.power_on(cut_at=torn.operations)
        try:
            tear(torn)
        except PowerCut:
            torn.power_on()
            self._on_cut(self.operations, torn)
        else:
            raise AssertionError("the supply was not cut")


def _branching(operation: Callable[..., None]) -> Any:
    """The operation, with a branch before it."""

    def branched(self: Any, *arguments: Any) -> None:
        self.before(lambda torn: operation(torn, *arguments))
        operation(self, *arguments)

    return branched


class FlashPlace(_Branching, SimulatedFlash):
    """A flash memory of the proof."""

    erase = _branching(SimulatedFlash.erase)
    _program_word = _branching(SimulatedFlash._program_word)

    def __init__(self, seed: int) -> None:
        super().__init__(SECTORS, SECTOR_SIZE, seed=seed)

    def backing(self) -> Backing:
        return FlashBacking(self)

    def twin(self) -> Self:
        made = self.copy()
        made.power_on()
        made._on_cut = None
        return made


class FolderPlace(_Branching, LossyFiles):
    """A folder of the proof."""

    append = _branching(LossyFiles.append)
    replace = _branching(LossyFiles.replace)
    truncate = _branching(LossyFiles.truncate)
    rename = _branching(LossyFiles.rename)
    sync = _branching(LossyFiles.sync)
    sync_folder = _branching(LossyFiles.sync_folder)

    def backing(self) -> Backing:
        return FolderBacking(Path("unused"), files=self, capacity=CAPACITY)

    def twin(self) -> Self:
        made = object.__new__(type(self))
        names, synced = deepcopy((self._names, self._synced_names))
        made.__dict__.update({**self.__dict__, "_names": names, "_synced_names": synced, "cut_at": None})
        made._on_cut = None
        return made
