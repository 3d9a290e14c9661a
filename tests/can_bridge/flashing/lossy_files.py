"""A folder whose supply can be lost at any call, and that loses then whatever a disk may lose.

Of a file: all that was written since it was last synchronised may be there, in part, as zeros, or not at all. Of the
folder: names given or changed since it was last synchronised are there up to one of the changes.
"""

from dataclasses import dataclass
from random import Random

from can_bridge.flashing.folder_files import FolderFiles
from can_bridge.flashing.medium import MediumError
from tests.can_bridge.flashing.medium import PowerCut


@dataclass(eq=False)
class _File:
    now: bytes = b""
    synced: bytes = b""


class LossyFiles(FolderFiles):
    """Attributes: `operations`, calls that changed something so far; `cut_at`, the number of the one that is torn."""

    def __init__(self, seed: int = 0) -> None:
        self.operations = 0
        self.cut_at: int | None = None
        self._seed = seed
        self._names: dict[str, _File] = {}
        self._synced_names: list[dict[str, _File]] = [{}]
        """The folder as it was synchronised, then after each change since."""

    def power_on(self, cut_at: int | None = None) -> None:
        self.cut_at = cut_at

    def read(self, name: str, offset: int = 0, length: int | None = None) -> bytes | None:
        if name not in self._names:
            return None
        now = self._names[name].now
        return now[offset:] if length is None else now[offset : offset + length]

    def size(self, name: str) -> int:
        return len(self.read(name) or b"")

    def append(self, name: str, data: bytes) -> None:
        cut = self._call()
        file = self._named(name)
        file.now += data
        self._lose(cut)

    def replace(self, name: str, data: bytes) -> None:
        cut = self._call()
        self._named(name).now = data
        self._lose(cut)

    def truncate(self, name: str, length: int) -> None:
        cut = self._call()
        if name not in self._names:
            raise MediumError(f"{name}: no such file", 0)
        self._names[name].now = self._names[name].now[:length]
        self._lose(cut)

    def rename(self, old: str, new: str) -> None:
        cut = self._call()
        self._names[new] = self._names.pop(old)
        self._synced_names.append(dict(self._names))
        self._lose(cut)

    def sync(self, name: str) -> None:
        cut = self._call()
        if not cut:
            self._names[name].synced = self._names[name].now
        self._lose(cut)

    def sync_folder(self) -> None:
        cut = self._call()
        if not cut:
            self._synced_names = [dict(self._names)]
        self._lose(cut)

    def _named(self, name: str) -> _File:
        if name not in self._names:
            self._names[name] = _File()
            self._synced_names.append(dict(self._names))
        return self._names[name]

    def _call(self) -> bool:
        cut = self.operations == self.cut_at
        self.operations += 1
        return cut

    def _lose(self, cut: bool) -> None:
        """What the disk has when the supply is back."""
        if not cut:
            return
        rng = Random(f"{self._seed} {self.operations}")
        self._names = dict(rng.choice(self._synced_names))
        self._synced_names = [dict(self._names)]
        for name in sorted(self._names):
            file = self._names[name]
            if file.now != file.synced:
                file.now = rng.choice((file.now, file.synced, self._mixed(rng, file)))
            # Another cut must not bring back what is gone.
            file.synced = file.now
        raise PowerCut

    def _mixed(self, rng: Random, file: _File) -> bytes:
        """The longer of the two, with a piece of what differs as it was, or as zeros."""
        same = next((n for n, (a, b) in enumerate(zip(file.now, file.synced, strict=False)) if a != b), None)
        if same is None:
            same = min(len(file.now), len(file.synced))
        kept = rng.randint(same, max(same, len(file.now)))
        rest = rng.choice((file.synced[kept:], bytes(max(0, len(file.now) - kept))))
        return file.now[:kept] + rest
