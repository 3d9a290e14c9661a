"""A folder that loses, with its supply, whatever a disk may lose; it branches before any of its operations.

In the branch the operation is torn, and the supply gone. So the sequence up to a cut runs once, however many cuts there
are. Of a file, all that was written since it was last synchronised may be there, in part, as zeros, or not at all. Of
the folder, names given or changed since it was last synchronised are there up to one of the changes.
"""

from collections.abc import Callable
from copy import deepcopy
from dataclasses import dataclass
from pathlib import Path
from random import Random
from typing import Self

from can_bridge.flashing.backing import Backing, MediumError
from can_bridge.flashing.folder_backing import FolderBacking, FolderFiles

OnCut = Callable[[int, "FolderPlace"], None]
"""Called with an operation's number and the memory as the cut in it leaves it."""


@dataclass(eq=False)
class _File:
    now: bytes = b""
    synced: bytes = b""


class FolderPlace(FolderFiles):
    """A folder of the proof. `operations` counts the calls that changed something so far."""

    def __init__(self, seed: int = 0) -> None:
        self.operations, self._seed = 0, seed
        self._names: dict[str, _File] = {}
        self._synced_names: list[dict[str, _File]] = [{}]
        """The folder as it was synchronised, then after each change since."""
        self.branch(lambda number: False, None)

    def backing(self) -> Backing:
        return FolderBacking(Path("unused"), files=self, capacity=256 * 1024)

    def branch(self, at: Callable[[int], bool], on_cut: OnCut | None) -> None:
        """Branch, from now on, before every operation whose number `at` picks; None: no more."""
        self._at, self._on_cut = at, on_cut

    def twin(self) -> Self:
        """A copy that goes its own way, without branches."""
        made = object.__new__(type(self))
        names, synced = deepcopy((self._names, self._synced_names))
        made.__dict__.update({**self.__dict__, "_names": names, "_synced_names": synced, "_on_cut": None})
        return made

    def read(self, name: str, offset: int = 0, length: int | None = None) -> bytes | None:
        if name not in self._names:
            return None
        return self._names[name].now[offset : None if length is None else offset + length]

    def size(self, name: str) -> int:
        return len(self.read(name) or b"")

    def append(self, name: str, data: bytes) -> None:
        self._change(lambda place: place._put(name, place._names[name].now + data if name in place._names else data))

    def replace(self, name: str, data: bytes) -> None:
        self._change(lambda place: place._put(name, data))

    def truncate(self, name: str, length: int) -> None:
        if name not in self._names:
            raise MediumError(f"{name}: no such file")
        self._change(lambda place: place._put(name, place._names[name].now[:length]))

    def rename(self, old: str, new: str) -> None:
        self._change(lambda place: place._rename(old, new))

    def sync(self, name: str) -> None:
        self._change(lambda place: setattr(place._names[name], "synced", place._names[name].now), is_sync=True)

    def sync_folder(self) -> None:
        self._change(lambda place: setattr(place, "_synced_names", [dict(place._names)]), is_sync=True)

    def _put(self, name: str, content: bytes) -> None:
        if name not in self._names:
            self._names[name] = _File()
            self._synced_names.append(dict(self._names))
        self._names[name].now = content

    def _rename(self, old: str, new: str) -> None:
        self._names[new] = self._names.pop(old)
        self._synced_names.append(dict(self._names))

    def _change(self, work: Callable[["FolderPlace"], None], *, is_sync: bool = False) -> None:
        """One operation, in the branch first, where a torn one that synchronises does nothing."""
        number, self.operations = self.operations, self.operations + 1
        if self._on_cut is not None and self._at(number):
            torn = self.twin()
            if not is_sync:
                work(torn)
            torn._lose()
            self._on_cut(number, torn)
        work(self)

    def _lose(self) -> None:
        """What the disk has when the supply is back."""
        rng = Random(f"{self._seed} {self.operations}")
        self._names = dict(rng.choice(self._synced_names))
        self._synced_names = [dict(self._names)]
        for name in sorted(self._names):
            file = self._names[name]
            if file.now != file.synced:
                file.now = rng.choice((file.now, file.synced, _mixed(rng, file)))
            # Another cut must not bring back what is gone.
            file.synced = file.now


def _mixed(rng: Random, file: _File) -> bytes:
    """The longer of the two, with a piece of what differs as it was, or as zeros."""
    same = next((n for n, (a, b) in enumerate(zip(file.now, file.synced, strict=False)) if a != b), None)
    if same is None:
        same = min(len(file.now), len(file.synced))
    kept = rng.randint(same, max(same, len(file.now)))
    rest = rng.choice((file.synced[kept:], bytes(max(0, len(file.now) - kept))))
    return file.now[:kept] + rest
