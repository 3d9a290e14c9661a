"""A folder that branches before any of its operations: in the branch the operation is torn, and the supply gone.

So the sequence up to a cut runs once, however many cuts there are: whatever outlives a loss of supply is in the memory.
"""

from collections.abc import Callable
from copy import deepcopy
from pathlib import Path
from typing import Any, Final, Self

from can_bridge.flashing.backing import Backing
from can_bridge.flashing.folder_backing import FolderBacking
from tests.can_bridge.flashing.lossy_files import LossyFiles
from tests.can_bridge.flashing.medium import PowerCut

CAPACITY: Final = 256 * 1024

OnCut = Callable[[int, "FolderPlace"], None]
"""Called with an operation's number and the memory as the cut in it leaves it."""


def _branching(operation: Callable[..., None]) -> Any:
    """The operation, with a branch before it."""

    def branched(self: Any, *arguments: Any) -> None:
        self._before(lambda torn: operation(torn, *arguments))
        operation(self, *arguments)

    return branched


class FolderPlace(LossyFiles):
    """A folder of the proof."""

    _at: Callable[[int], bool]
    _on_cut: OnCut | None = None

    append = _branching(LossyFiles.append)
    replace = _branching(LossyFiles.replace)
    truncate = _branching(LossyFiles.truncate)
    rename = _branching(LossyFiles.rename)
    sync = _branching(LossyFiles.sync)
    sync_folder = _branching(LossyFiles.sync_folder)

    def backing(self) -> Backing:
        """Open it, after power-on."""
        return FolderBacking(Path("unused"), files=self, capacity=CAPACITY)

    def branch(self, at: Callable[[int], bool], on_cut: OnCut | None) -> None:
        """From now on, branch before every operation whose number `at` picks; None: no more."""
        self._at, self._on_cut = at, on_cut

    def twin(self) -> Self:
        """A copy that goes its own way, powered, without branches."""
        made = object.__new__(type(self))
        names, synced = deepcopy((self._names, self._synced_names))
        made.__dict__.update({**self.__dict__, "_names": names, "_synced_names": synced, "cut_at": None})
        made._on_cut = None
        return made

    def _before(self, tear: Callable[[Any], None]) -> None:
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
