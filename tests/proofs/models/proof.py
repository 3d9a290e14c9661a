"""The fail-safe and flashing, explored state by state: the code itself, with every input, and every cut of the supply.

    python -m tests.proofs.models --json results/models.json

An exploration ends when no new state appears, and what it says holds for any number of steps. A sabotage is a line of
the exported C that is changed in a copy: the exploration must find it.
"""

import subprocess
import tomllib
from collections.abc import Mapping
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, Final

from benchmarks.common.command_line import track
from contract.errors import StillwakeError
from ecu.c.sources import loader_sources
from ecu.in_c import compiler
from tests.proofs.command_line import JsonFile, report
from tests.proofs.ecu_in_c.planted import Planted
from tests.proofs.models import fail_safe

SABOTAGE: Final = tomllib.loads(Path(__file__).with_name("sabotage.toml").read_text(encoding="utf-8"))
_FEW: Final = 1_500
"""States in which a sabotage of flashing has to be found."""
_COMPILED: Final = (
    "sw_hashes.c", "sw_records.c", "sw_release.c", "sw_store.c", "sw_store_judge.c", "sw_store_kept.c",
)  # fmt: skip
SECTOR: Final = 960
"""Bytes of a sector: an image, or a key list and two states, so that every second state changes the sector."""
_FLAGS: Final = (
    "-O1", "-w", "-ffunction-sections", "-Wl,--gc-sections", f"-DSW_FLASH_SECTOR={SECTOR}u", "-DSW_SLOT_SECTORS=1u",
)  # fmt: skip


class FoundError(AssertionError):
    """A state or step that is not allowed, with the calls that lead there."""


def store_sources() -> dict[str, bytes]:
    """The store's files, and the program; signatures are the program's."""
    found = {name: raw for name, raw in loader_sources().items() if name.endswith(".h") or name in _COMPILED}
    return found | {path.name: path.read_bytes() for path in Path(__file__).with_name("c").glob("store_*")}


def explored_flashing(folder: Path, most: int = 2**31, contents: Mapping[str, bytes] | None = None) -> dict[str, int]:
    """What `c/store_states.c` counts in at most so many states of the store's own C, over a small flash memory whose
    supply is cut; raises FoundError for what is not allowed."""
    program = folder / "store_states"
    made_from = store_sources() if contents is None else contents
    compiler.compile_c(made_from, program, compiler=compiler.host_compiler(), flags=_FLAGS)
    done = subprocess.run([str(program), str(most)], stdout=subprocess.PIPE, text=True, check=False)
    if done.returncode == 1:
        raise FoundError(done.stdout)
    done.check_returncode()
    return {name: int(count) for name, count in (line.split() for line in done.stdout.splitlines())}


def found_in_fail_safe(one: dict[str, str], folder: Path) -> str:
    """What the exploration of the fail-safe says to a changed line; "" if it finds nothing."""
    for config in fail_safe.SETTINGS.values():
        try:
            fail_safe.explored(fail_safe.Pair(config, folder, (one["old"], one["new"])))
        except fail_safe.ViolationError as error:
            return str(error).partition(", after")[0]
    return ""


def found_in_flashing(one: dict[str, str], folder: Path) -> str:
    """What the exploration of flashing says to a changed line; "" if it finds nothing."""
    try:
        explored_flashing(folder, _FEW, Planted(variant="", **one).into(store_sources()))
    except FoundError as error:
        return str(error).splitlines()[-1].partition(": ")[2]
    return ""


def main(json_file: JsonFile = None) -> None:
    """Explore both, then each sabotage. Fails at the first state that is not allowed, and says how it is reached."""
    finders = {"fail_safe": found_in_fail_safe, "flashing": found_in_flashing}
    parts = dict[str, dict[str, Any]]()
    with TemporaryDirectory() as name:
        folder = Path(name)
        of_settings = [
            fail_safe.explored(fail_safe.Pair(config, folder))
            for config in track(fail_safe.SETTINGS.values(), "fail-safe", "settings")
        ]
        parts["fail_safe"] = {key: sum(one[key] for one in of_settings) for key in of_settings[0]}
        parts["flashing"] = explored_flashing(folder)
        sabotaged = [
            {"part": part, "what": one["what"], "found": finders[part](one, folder)}
            for part in finders
            for one in track(SABOTAGE[part], part, "sabotages")
        ]
    found = sum(bool(one["found"]) for one in sabotaged)
    figures = {**parts, "sabotage": len(sabotaged), "sabotage_found": found, "sabotaged": sabotaged}
    used = fail_safe.SETTINGS.items()
    settings = {name: {key: getattr(config, key) for key in fail_safe.LENGTHS} for name, config in used}
    report(
        json_file, "models", figures, packages=("stillwake",), shown=("fail_safe", "flashing", "sabotage_found"),
        settings=settings, sector_bytes=SECTOR,
    )  # fmt: skip
    if missed := [one["what"] for one in sabotaged if not one["found"]]:
        raise StillwakeError(f"{missed[0]}: the sabotage is not found")
