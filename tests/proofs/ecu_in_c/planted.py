"""Faults that are planted in the C sources, one at a time: the comparison has to notice every one."""

import tomllib
from collections.abc import Mapping
from pathlib import Path
from typing import Final, NamedTuple


class Planted(NamedTuple):
    """A text that stands in a source once, another one, what is wrong then, and the variant in which it can be seen."""

    file: str
    old: str
    new: str
    what: str = ""
    variant: str = ""

    def into(self, sources: Mapping[str, bytes]) -> dict[str, bytes]:
        """The sources with the other text; raises ValueError if the old one does not stand there once."""
        before = sources[self.file].decode()
        if before.count(self.old) != 1:
            raise ValueError(f"{self.file}: {self.old!r} stands there {before.count(self.old)} times: must be once")
        return {**sources, self.file: before.replace(self.old, self.new).encode()}


def listed(path: Path, name: str = "planted") -> tuple[Planted, ...]:
    return tuple(Planted(**item) for item in tomllib.loads(path.read_text(encoding="utf-8"))[name])


PLANTED: Final = listed(Path(__file__).with_suffix(".toml"))
