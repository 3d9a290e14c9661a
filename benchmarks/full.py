"""Make every file in `results/` with the commands in `full.toml`; `make full` runs this module after the tests.

    python -m benchmarks full [--resume] [--only NAME] [--list]

A file made by a command gets a stamp: the release and the C sources on which its figures depend, the version, and the
duration. From the stamps, a test finds files of an earlier release, and `--resume` finds missing and outdated files.
"""

import hashlib
import json
import os
import re
import shlex
import shutil
import subprocess
import sys
import time
import tomllib
from collections.abc import Sequence
from dataclasses import dataclass
from fnmatch import fnmatch
from functools import cache
from importlib.util import find_spec
from pathlib import Path
from typing import Annotated, Any, Final

import typer
from rich.table import Table

from benchmarks.common.command_line import ROOT, console
from benchmarks.common.documents import STAMP, read
from contract.atomic import replacing
from contract.errors import StillwakeError
from contract.release import bundle
from contract.results import versions
from contract.shipped import BUNDLE
from ecu.c.sources import sources_in as firmware_part
from export.to_c.library import sources_in as step_part

RESULTS: Final = ROOT / "results"
PLAN: Final = Path(__file__).with_suffix(".toml")
RELEASE: Final = "release"
_OF_ECU: Final = {"ecu": "", "secoc": "secoc", "store": "store", "loader": "loader", "board": "board"}
"""Folders below `ecu/c`, by their names in `full.toml`. Other names in `full.toml` are folders of the control step."""
_COMMENT: Final = re.compile(rb"/\*.*?\*/", re.DOTALL)


@dataclass(frozen=True, kw_only=True)
class Figures:
    """A file in `results/` and the command that makes it. The fields are explained at the top of `full.toml`."""

    name: str
    run: str
    before: Sequence[str] = ()
    of: Sequence[str] = ()
    status: int = 0
    old: str = ""
    needs: str = ""

    @property
    def file(self) -> Path:
        return RESULTS / f"{self.name}.json"

    def stamp(self) -> dict[str, Any]:
        """Return the stamp that the file would get now, with the present release, sources and version."""
        of = {name: release() if name == RELEASE else sources_hash(name) for name in self.of}
        return {"version": versions("stillwake")["stillwake"], "of": of}

    def is_current(self) -> bool:
        """Return whether the file was made with the present release and sources, and with the present minor version."""
        there, present = made(self.file), self.stamp()
        minor, its_minor = (str(stamp.get("version")).rpartition(".")[0] for stamp in (present, there))
        return its_minor == minor and bool(there["of"] == present["of"])


def plan(path: Path = PLAN) -> tuple[list[Figures], dict[str, str]]:
    """Return the files to make, in order, and a description of each results file of finished studies."""
    tree = tomllib.loads(path.read_text(encoding="utf-8"))
    history = tree.pop("history")
    return [Figures(name=name, **fields) for name, fields in tree.items()], history


def made(file: Path) -> dict[str, Any]:
    """Return the stamp in a file; empty if the file has no stamp."""
    found: dict[str, Any] = read(file)["facts"].get(STAMP, {}) if file.is_file() else {}
    return found


@cache
def release() -> str:
    """Return the first digits of the shipped release's digest."""
    return bundle.load(BUNDLE).digest[:12]


@cache
def sources_hash(folder: str) -> str:
    """Return the hash of the C sources in a folder; their comments are left out."""
    everything = hashlib.sha256()
    sources = firmware_part(_OF_ECU[folder]) if folder in _OF_ECU else step_part(folder)
    for name, content in sorted(sources.items()):
        everything.update(name.encode() + _COMMENT.sub(b"", content))
    return everything.hexdigest()[:12]


def main(
    resume: Annotated[bool, typer.Option("--resume", help="Make only missing and outdated files.")] = False,
    only: Annotated[list[str], typer.Option(help="Names of files, such as 'bus_*' (repeatable).")] = [],  # noqa: B006
    show: Annotated[bool, typer.Option("--list", help="List the files and run nothing.")] = False,
) -> None:
    """Make the files in `results/`, one after another; a stopped run continues with --resume."""
    figures, _ = plan()
    chosen = [one for one in figures if not only or any(fnmatch(one.name, pattern) for pattern in only)]
    if not chosen:
        raise StillwakeError(f"--only {only[0]}: no such file; must be one of {', '.join(one.name for one in figures)}")
    if show:
        _list(chosen)
        return
    for number, one in enumerate(chosen, 1):
        head = f"{number}/{len(chosen)} {one.name}"
        if one.needs and shutil.which(one.needs) is None and find_spec(one.needs) is None:
            console.print(f"{head}: left out, because {one.needs} is missing")
        elif resume and one.is_current() and made(one.file).get("version") == one.stamp()["version"]:
            console.print(f"{head}: there already")
        else:
            last = made(one.file).get("minutes")
            console.print(f"{head}: {one.run}" + (f" ({last:.0f} min the last time)" if last else ""))
            _make(one)


def _make(one: Figures) -> None:
    began, before = time.monotonic(), made(one.file).get("minutes")
    for command in one.before:
        _call(one, command)
    # The path is relative, because some files state the command that made them.
    _call(one, one.run, "--json", os.path.relpath(one.file, ROOT), good=(0, one.status))
    content, minutes = read(one.file), round((time.monotonic() - began) / 60.0, 1)
    # A continued campaign takes less time than a whole campaign, so the earlier duration is kept.
    if before is not None and content["facts"].get("runs", {}).get("kept", 0) > 0:
        minutes = before
    content["facts"][STAMP] = {**one.stamp(), "minutes": minutes}
    with replacing(one.file) as temporary:
        temporary.write_text(json.dumps(content, indent=2) + "\n", encoding="utf-8")


def _call(one: Figures, command: str, *more: str, good: tuple[int, ...] = (0,)) -> None:
    places = {**os.environ, "PATH": f"{Path(sys.executable).parent}{os.pathsep}{os.environ.get('PATH', '')}"}
    if subprocess.run([*shlex.split(command), *more], cwd=ROOT, env=places, check=False).returncode not in good:
        raise StillwakeError(f"{one.name}: {command!r} failed; `python -m benchmarks full --resume` continues here")


def _list(chosen: list[Figures]) -> None:
    table = Table("results/", "made by", "min", "of the present release and sources", box=None, pad_edge=False)
    for one in chosen:
        minutes = made(one.file).get("minutes")
        state = "yes" if one.is_current() else one.old or "no"
        table.add_row(one.name, " ".join(one.run.split()), "" if minutes is None else f"{minutes:g}", state)
    console.print(table)
