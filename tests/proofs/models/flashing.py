"""The store's states: its own C, explored by `c/store_states.c` over a small flash memory with cuts of the supply."""

import subprocess
from collections.abc import Mapping
from pathlib import Path
from typing import Final

from ecu.c.sources import loader_sources
from ecu.in_c import compiler

_COMPILED: Final = (
    "sw_hashes.c", "sw_records.c", "sw_release.c", "sw_store.c", "sw_store_judge.c", "sw_store_kept.c",
)  # fmt: skip
SECTOR: Final = 960
"""Bytes of a sector: an image, or a key list and two states, so that every second state changes the sector."""
_FLAGS: Final = (
    "-O1",
    "-w",
    "-ffunction-sections",
    "-Wl,--gc-sections",
    f"-DSW_FLASH_SECTOR={SECTOR}u",
    "-DSW_SLOT_SECTORS=1u",
)
ENDLESS: Final = 2**31
"""More states than there are."""


class FoundError(AssertionError):
    """A state or step that is not allowed, with the calls that lead there."""


def sources() -> dict[str, bytes]:
    """The store's files, and the program; signatures are the program's."""
    found = {name: raw for name, raw in loader_sources().items() if name.endswith(".h") or name in _COMPILED}
    return found | {path.name: path.read_bytes() for path in Path(__file__).with_name("c").glob("store_*")}


def explored(folder: Path, most: int = ENDLESS, contents: Mapping[str, bytes] | None = None) -> dict[str, int]:
    """What the program counted in at most so many states; raises FoundError for what is not allowed."""
    program = folder / "store_states"
    made_from = sources() if contents is None else contents
    compiler.compile_c(made_from, program, compiler=compiler.host_compiler(), flags=_FLAGS)
    done = subprocess.run([str(program), str(most)], stdout=subprocess.PIPE, text=True, check=False)
    if done.returncode == 1:
        raise FoundError(done.stdout)
    done.check_returncode()
    return {name: int(count) for name, count in (line.split() for line in done.stdout.splitlines())}
