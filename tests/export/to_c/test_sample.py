"""The sample folders, and the sources in place, parsed as editors do: by the flags of `compile_flags.txt`."""

import subprocess
from importlib.resources import files
from pathlib import Path

import pytest

from contract.controller.c_folder import COMPILE_FLAGS
from ecu.in_c.compiler import host_compiler

SOURCES = Path(str(files("export.to_c").joinpath("sources")))
SAMPLES = "../../../../build/c"
"""The place of the samples, seen from a folder of the sources."""


def parse(folder: Path, flags: list[str]) -> None:
    compiler = host_compiler()
    if "ziglang" in compiler:
        pytest.skip("ziglang has no -fsyntax-only")
    sources = sorted(item.name for item in folder.glob("*.c"))
    done = subprocess.run([*compiler, "-fsyntax-only", "-Werror", *flags, *sources], cwd=folder, check=False)
    assert done.returncode == 0


def flags_of(folder: Path) -> list[str]:
    return (folder / COMPILE_FLAGS).read_text().split()


def test_samples_and_sources_in_place_are_parsed_by_their_flags(samples):
    for kind in ("float32", "int8"):
        parse(samples / kind, flags_of(samples / kind))
    for folder in ("step", "float32", "int8"):
        flags = flags_of(SOURCES / folder)
        assert any(SAMPLES in flag for flag in flags)
        parse(SOURCES / folder, [flag.replace(SAMPLES, str(samples)) for flag in flags])
