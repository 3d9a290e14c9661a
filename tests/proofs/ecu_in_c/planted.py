"""Faults that are planted in the C sources, one at a time: the comparison has to notice every one."""

import tomllib
from pathlib import Path
from typing import Final, NamedTuple


class Planted(NamedTuple):
    """A fault.

    Attributes:
        what: is wrong.
        variant: of the vehicle in which it can be seen.
        file: of the source.
        old, new: text in it; the old one stands there once.
    """

    what: str
    variant: str
    file: str
    old: str
    new: str

    def into(self, sources: dict[str, bytes]) -> dict[str, bytes]:
        """The sources with it; raises ValueError if they no longer have the place."""
        before = sources[self.file].decode()
        if before.count(self.old) != 1:
            raise ValueError(f"{self.file}: {self.old!r} stands there {before.count(self.old)} times: must be once")
        return sources | {self.file: before.replace(self.old, self.new).encode()}


PLANTED: Final = tuple(
    Planted(**item)
    for item in tomllib.loads(Path(__file__).with_suffix(".toml").read_text(encoding="utf-8"))["planted"]
)
