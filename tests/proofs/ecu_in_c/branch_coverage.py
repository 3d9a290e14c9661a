"""Branches of the ECU's C that recorded periods take, by gcc and gcovr; the networks' arithmetic is not among them."""

import json
import shutil
import subprocess
import sys
from collections.abc import Iterable, Iterator, Mapping, Sequence
from importlib.util import find_spec
from pathlib import Path
from typing import Any, Final

from contract.errors import LibraryError
from tests.proofs.ecu_in_c.library import EXACT, Layout, ecu_files, sources
from tests.proofs.ecu_in_c.variants import VARIANTS

REPLAY: Final = "twin_replay.c"
EXCLUDED: Final = {
    ("sw_ecu.c", "(interventions & SW_GATED_NOT_FINITE) != 0"): "no plan that is not finite gets as far as the gate",
    ("sw_ecu.c", "status == SW_OK ? SW_REASON_NONE : SW_REASON_INTERNAL"): "the networks' stand-in knows its answer",
    ("sw_ecu.c", "(int)unfit : (int)sw_inexact()"): "the networks' stand-in knows its answer; see test_c_ecu.py",
    ("sw_cmac.c", "length - at == SW_AES_BYTES"): "no message of the bus ends with a whole block; RFC 4493's do",
    ("sw_sensors.c", "cp != NULL && memory->rows > 0"): "with pressures, the window has their row",
}
"""Branches that nothing leads to, by the text of their line, and why they stand there all the same."""


def is_possible() -> bool:
    return shutil.which("gcc") is not None and find_spec("gcovr") is not None


def replay_program(
    name: str, folder: Path, flags: Sequence[str], contents: Mapping[str, bytes] | None = None
) -> tuple[Path, Path]:
    """A program that lives through recorded periods of a variant, and its file of what is compared. All variants share
    the ECU's sources in `folder`/src, so that what is found of them can be added up, and have headers of their own."""
    contents = sources(VARIANTS[name]) if contents is None else contents
    common, own = folder / "src", folder / name.replace(" ", "_").replace(",", "")
    common.mkdir(exist_ok=True)
    own.mkdir(exist_ok=True)
    shared = ecu_files().keys() | {"twin.c", "twin.h"}
    for file, content in contents.items():
        (common if file in shared else own).joinpath(file).write_bytes(content)
    (common / REPLAY).write_bytes(Path(__file__).with_name("c").joinpath(REPLAY).read_bytes())
    found = sorted(str(path) for path in common.glob("*.c"))
    command = ["gcc", "-std=c99", "-w", f"-I{common}", f"-I{own}", *EXACT, *flags, *found, "-o", str(own / "replay")]
    done = subprocess.run(command, cwd=own, capture_output=True, text=True, check=False)
    if done.returncode:
        raise LibraryError(f"gcc: {done.stderr.splitlines()[0]}")
    compared = own / "compared"
    compared.write_bytes(Layout(contents).compared)
    return own / "replay", compared


def measured(recordings: Mapping[str, Sequence[bytes]], folder: Path) -> dict[str, Any]:
    """`branches`, the share of them that is taken, and `branches_missed`: places with a branch that is never taken,
    `file:line: text`, with what `EXCLUDED` has without need."""
    for name, items in recordings.items():
        program, compared = replay_program(name, folder, ("-O0", "--coverage"))
        for item in items:
            periods = program.with_name("periods")
            periods.write_bytes(item)
            subprocess.run([program, compared, periods], capture_output=True, check=True)
    found = branches(folder / "src", str(folder), "--exclude", ".*twin.c", "--exclude", f".*{REPLAY}")
    each = [(f"{file}:{at}", count) for file, at, counts in found for count in counts]
    never = [name for name, count in each if count == 0]
    missed = without_reason(never, EXCLUDED)
    total = len(each) - sum(name not in missed for name in never)
    percent = round(100.0 * (len(each) - len(never)) / total, 2)
    return {"branches": total, "branch_coverage_percent": percent, "branches_missed": missed}


def branches(root: Path, *options: str) -> Iterator[tuple[str, str, list[int]]]:
    """(file, `line: text`, how often each branch there is taken) of sources compiled with `--coverage`, after a run."""
    report = root / "coverage.json"
    command = [sys.executable, "-m", "gcovr", "--root", str(root), "--json", str(report)]
    command += ["--merge-mode-functions", "separate", *(options or [str(root)])]
    subprocess.run(command, cwd=root, capture_output=True, check=True)
    for file in json.loads(report.read_text())["files"]:
        text = (root / file["file"]).read_text().splitlines()
        for line in file["lines"]:
            number = line["line_number"]
            yield file["file"], f"{number}: {text[number - 1].strip()}", [one["count"] for one in line["branches"]]


def without_reason(never: Iterable[str], reasons: Mapping[tuple[str, str], str]) -> list[str]:
    """Places, `file:line: text`, that have no reason by file and text of the line; and reasons for what is taken."""
    places = set(never)
    named = {key: {one for one in places if one.startswith(f"{key[0]}:") and key[1] in one} for key in reasons}
    idle = [f"{key} is taken" for key, found in named.items() if not found]
    return sorted(places.difference(*named.values())) + idle
