"""Faults that are planted in the C sources, one at a time: the comparison has to notice every one."""

import tomllib
from collections.abc import Mapping
from pathlib import Path
from typing import Final, NamedTuple


class Planted(NamedTuple):
    """What is wrong, a text that stands in a source once, another one, and the variant in which it can be seen."""

    what: str
    file: str
    old: str
    new: str
    variant: str = ""

    def into(self, sources: Mapping[str, bytes]) -> dict[str, bytes]:
        return changed(sources, self.file, self.old, self.new)


def changed(sources: Mapping[str, bytes], file: str, old: str, new: str) -> dict[str, bytes]:
    """The sources with another text in place of one; raises ValueError if that does not stand there once."""
    before = sources[file].decode()
    if before.count(old) != 1:
        raise ValueError(f"{file}: {old!r} stands there {before.count(old)} times: must be once")
    return {**sources, file: before.replace(old, new).encode()}


def listed(path: Path) -> tuple[Planted, ...]:
    return tuple(Planted(**item) for item in tomllib.loads(path.read_text(encoding="utf-8"))["planted"])


PLANTED: Final = listed(Path(__file__).with_suffix(".toml"))
