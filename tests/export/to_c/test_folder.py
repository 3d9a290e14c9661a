"""The C library's folder as someone meets it who has nothing else: built by its own rules, called from C++, and parsed
as editors do, by the flags of `compile_flags.txt`."""

import re
import shutil
import subprocess
from functools import partial
from importlib.resources import files
from pathlib import Path

import pytest

from contract.controller.c_folder import COMPILE_FLAGS, DOCUMENTS, EXPECTED, RECORDED, REPLAY
from ecu.in_c.compiler import STANDARD, host_compiler, zig_compiler
from ecu.in_c.host_library import CController
from examples import c_samples

SOURCES = Path(str(files("export.to_c").joinpath("sources")))
SAMPLES = "../../../../build/c"
"""The place of the samples, seen from a folder of the sources."""
CPP = Path(__file__).with_name("c").joinpath("main.cpp").read_bytes()


def done(command: list[str], folder: Path) -> subprocess.CompletedProcess[str]:
    return subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)


@pytest.fixture(scope="module")
def samples(tmp_path_factory) -> Path:
    """The sample folders, with one build for the expected answers and for the known one."""
    folder: Path = tmp_path_factory.mktemp("samples") / "c"
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(c_samples, "CController", partial(CController, flags=("-O1", "-ffp-contract=off")))
        c_samples.main(folder)
    return folder


@pytest.fixture
def folder(samples, tmp_path) -> Path:
    return shutil.copytree(samples / "int8", tmp_path / "c")


def cpp_compiler() -> list[str]:
    for name in ("c++", "g++", "clang++"):
        if shutil.which(name):
            return [name]
    zig = zig_compiler()
    if zig is None:
        pytest.skip("no C++ compiler")
    return [*zig[:-1], "c++"]


@pytest.mark.proofs  # a build of its own; that of the README stays
@pytest.mark.compiler
def test_a_cpp_program_links_to_the_library(folder):
    (folder / "main.cpp").write_bytes(CPP)
    sources = [item.name for item in folder.glob("*.c") if item.name != REPLAY]
    assert done([*host_compiler(), "-std=c99", "-O1", "-c", *sources], folder).returncode == 0
    objects = [name.replace(".c", ".o") for name in sources]
    strict = ["-std=c++11", "-Wall", "-Wextra", "-Werror"]
    built = done([*cpp_compiler(), *strict, "main.cpp", *objects, "-o", "program"], folder)
    assert (built.returncode, built.stderr) == (0, "")
    answered = done(["./program"], folder)
    assert answered.returncode == 0
    float(answered.stdout)


@pytest.mark.slow  # builds the folder as a stranger would
def test_the_readmes_line_builds_an_example_that_answers_as_expected(folder):
    """And no compiler has a warning of it at this optimisation."""
    flags = [*STANDARD, "-Wshadow", "-Werror", "-O3", "-march=native", "-ffp-contract=fast"]
    built = done([*host_compiler(), *flags, *(item.name for item in folder.glob("*.c")), "-o", "replay"], folder)
    assert (built.returncode, built.stderr) == (0, "")
    lines = (folder / EXPECTED).read_text().splitlines()
    found = done(["./replay", RECORDED, EXPECTED], folder)
    assert (found.returncode, found.stdout) == (0, f"{len(lines)} answers, all as expected\n")
    # One number of one line off by a hundredth; a line that is missing; a file that is not there; no rows.
    numbers = lines[3].split()
    planted = [*lines[:3], " ".join([*numbers[:3], str(float(numbers[3]) + 0.01)]), *lines[4:]]
    for expected, message in ((planted, "expected"), (lines[:3], "no answer is expected")):
        (folder / EXPECTED).write_text("\n".join(expected))
        assert message in done(["./replay", RECORDED, EXPECTED], folder).stderr
    assert "a file cannot be read" in done(["./replay", RECORDED, "nowhere"], folder).stderr
    (folder / RECORDED).write_text("")
    assert "fewer rows" in done(["./replay", RECORDED, EXPECTED], folder).stderr


@pytest.mark.slow
def test_the_documents_are_filled_in_with_the_program_and_the_compilers_sizes(folder):
    assert all((folder / name).is_file() for name in DOCUMENTS)
    text = (folder / "README.md").read_text()
    assert not re.findall(r"@[A-Z_]+@", text)
    (program,) = re.findall(r'SW_PROGRAM_SHA256 "(\w+)"', (folder / "sw_settings.h").read_text())
    assert program in text
    stated = [re.findall(rf"`{name}` \| (\d+)", text)[0] for name in ("sw_input", "sw_output")]
    (folder / "sizes.c").write_text(
        '#include <stdio.h>\n#include "stillwake.h"\n'
        'int main(void) { printf("%d %d", (int)sizeof(sw_input), (int)sizeof(sw_output)); return 0; }\n'
    )
    assert done([*host_compiler(), "-std=c99", "sizes.c", "-o", "sizes"], folder).returncode == 0
    assert done(["./sizes"], folder).stdout.split() == stated


def parse(folder: Path, flags: list[str]) -> None:
    sources = sorted(item.name for item in folder.glob("*.c"))
    parsed = done([*host_compiler(), "-fsyntax-only", "-Werror", *flags, *sources], folder)
    assert (parsed.returncode, parsed.stderr) == (0, "")


def flags_of(folder: Path) -> list[str]:
    return (folder / COMPILE_FLAGS).read_text().split()


@pytest.mark.skipif("ziglang" in host_compiler(), reason="ziglang has no -fsyntax-only")
def test_samples_and_sources_in_place_are_parsed_by_their_flags(samples):
    for kind in ("float32", "int8"):
        parse(samples / kind, flags_of(samples / kind))
    for folder in ("step", "float32", "int8"):
        flags = flags_of(SOURCES / folder)
        assert any(SAMPLES in flag for flag in flags)
        parse(SOURCES / folder, [flag.replace(SAMPLES, str(samples)) for flag in flags])
