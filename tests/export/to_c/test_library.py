"""What the C library promises whoever compiles it: standard, silent, freestanding, sane, and whole or not written."""

import re
import shutil
import subprocess

import numpy as np
import pytest

from contract.config.controller import MpcConfig
from contract.config.learning import ModelConfig
from contract.controller.c_folder import PROGRAM_SETTINGS, library_sources, rows_text, write_folder
from ecu.in_c.compiler import host_compiler
from examples.random_programs import random_program
from export.program.controller_program import random_window
from export.reference.mpc import control_step
from export.release.pipeline import rows_of
from export.to_c.library import c_library, int8_library

MODEL = ModelConfig(window=6, latent=3, lstm_width=17, dynamics_width=21, decoder_width=9)
PROGRAM = random_program(3, model=MODEL, mpc=MpcConfig(horizon=7))
SERIES = np.concatenate([random_window(PROGRAM, np.random.default_rng(seed)) for seed in range(4)])
WINDOWS = [SERIES[i : i + PROGRAM.window] for i in range(len(SERIES) - PROGRAM.window + 1)]


@pytest.fixture(scope="module", params=["float32", "int8"])
def contents(request) -> dict[str, bytes]:
    return c_library(PROGRAM) if request.param == "float32" else int8_library(PROGRAM, WINDOWS)


@pytest.mark.slow
def test_cppcheck_finds_nothing(tmp_path, contents):
    write_folder(tmp_path / "c", contents)
    if shutil.which("cppcheck") is None:
        pytest.skip("cppcheck is not installed")
    options = ("--enable=warning,style,performance,portability", "--std=c99", "--quiet", "--error-exitcode=1")
    # The README asks a compiler for arithmetic shifts; a pointer that could be one to const is a matter of taste.
    # Conditions that are known here depend on a release's settings or on how a build computes; the decoder's variables
    # are those of its assembly, which cppcheck does not read.
    known = (
        *("shiftTooManyBitsSigned", "constVariablePointer", "constParameterPointer", "knownConditionTrueFalse"),
        *("unusedVariable:sw_decoder.c", "unreadVariable:sw_decoder.c"),
    )
    suppressed = [f"--suppress={name}" for name in known]
    done = subprocess.run(
        ["cppcheck", *options, *suppressed, "."], cwd=tmp_path / "c", capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr


def test_it_calls_nothing_and_writes_no_static_memory_and_has_no_warning(tmp_path, contents, shared_builds):
    """Undefined symbols: only what every freestanding compiler may call by itself. No .data, no .bss."""
    if shutil.which("nm") is None:
        pytest.skip("nm is not installed")
    library, flags = tmp_path / "library.o", ("-r", "-Wshadow", "-Wstrict-prototypes", "-O2", "-ffreestanding")
    shared_builds.compile_c(library_sources(contents), library, compiler=host_compiler(), flags=flags)
    listing = subprocess.run(["nm", library], capture_output=True, text=True, check=True).stdout
    symbols = re.findall(r"^\s*(?:[0-9a-f]+)?\s+([A-Za-z])\s+(\S+)$", listing, flags=re.MULTILINE)
    assert {name for kind, name in symbols if kind == "U"} <= {"memset", "memcpy", "memmove"}
    assert not [name for kind, name in symbols if kind in "dDbBcC"]
    assert ("T", "sw_control_step") in symbols


@pytest.mark.compiler  # builds with sanitisers
def test_sanitisers_find_nothing_in_a_recorded_sequence(tmp_path, contents, shared_builds):
    """And the example program prints what the reference computes; tests/ecu/in_c/test_c_image.py has plain int8."""
    if shutil.which("gcc") is None:
        pytest.skip("gcc is not installed")
    integers = b'#define SW_PRECISION "int8"' in contents[PROGRAM_SETTINGS]
    program, flags = tmp_path / "replay", ("-march=native",) if integers else ()
    sanitisers = ("-fsanitize=address,undefined,float-divide-by-zero", "-fno-sanitize-recover=all")
    shared_builds.compile_c(contents, program, compiler=["gcc"], flags=("-O0", "-g1", *sanitisers, *flags))
    windows = [window.astype(np.float32).astype(np.float64) for window in WINDOWS]
    done = subprocess.run([program], input=rows_text(rows_of(windows)), capture_output=True, text=True, check=True)
    found = np.array([line.split() for line in done.stdout.splitlines()], dtype=np.float64)
    plan, expected = np.zeros(PROGRAM.mpc.horizon), []
    for window in windows:
        solution = control_step(PROGRAM, window, plan, np.ones(PROGRAM.mpc.horizon))
        plan = solution.plan
        expected.append([plan[0], *solution.forces.mean(axis=0), solution.cost])
    # As in the parity tests of a closed loop; int8 weights change the model by some parts in a thousand.
    np.testing.assert_allclose(found, expected, rtol=0, atol=0.02 if integers else 2.5e-5)
