"""The int8 library on an emulated AArch64 processor: the host's answers to the bit, by every kind of product."""

import platform
import shutil
import subprocess
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest

from contract.config.controller import MpcConfig
from contract.config.learning import ModelConfig
from contract.controller.c_folder import ProgramRows, float_literal, library_sources
from contract.controller.interface import Sizes
from ecu.in_c.compiler import zig_compiler
from ecu.in_c.host_library import CController
from examples.random_programs import random_program
from export.program.controller_program import random_window
from export.to_c.library import int8_library

EMULATOR = shutil.which("qemu-aarch64") or shutil.which("qemu-aarch64-static")
COMPILER = zig_compiler()
# No C library: to build one for each processor would take minutes.
BARE = ("-target", "aarch64-linux-none", "-ffreestanding", "-nostdlib", "-static", "-Wl,-e,begin")
PLAIN = (*BARE, "-mcpu=cortex_a72")
DOT_PRODUCTS = (*BARE, "-mcpu=cortex_a76")
PROGRAM = Path(__file__).parent / "c" / "aarch64_main.c"

pytestmark = [
    pytest.mark.proofs,  # another processor's builds
    pytest.mark.compiler,
    pytest.mark.skipif(COMPILER is None, reason="ziglang (extra mcu) is not installed"),
]


class Library(NamedTuple):
    sources: dict[str, bytes]
    sizes: Sizes
    rows: ProgramRows


@pytest.fixture(scope="module")
def library() -> Library:
    """A net whose layers are no whole tiles, and rows of which some drive activations to the ends of 16 bits."""
    model = ModelConfig(window=6, latent=5, lstm_width=13, dynamics_width=29, decoder_width=19)
    program = random_program(1, model=model, mpc=MpcConfig(horizon=7))
    rng = np.random.default_rng(0)
    windows = [random_window(program, rng) for _ in range(4)]
    rows = np.concatenate([*windows, 8.0 * windows[0]]).astype(np.float32)
    return Library(int8_library(program, windows), program.sizes, rows)


@pytest.fixture(scope="module", params=[PLAIN, DOT_PRODUCTS], ids=["plain", "dot products"])
def program(request, library, tmp_path_factory, shared_builds) -> tuple[bool, Path]:
    """Whether it may use the dot-product instructions, and the program."""
    values = ", ".join("{" + ", ".join(map(float_literal, row)) + "}" for row in library.rows)
    rows = f"#define ROWS {len(library.rows)}\n#define VALUES {values}\n"
    path = tmp_path_factory.mktemp("aarch64") / "program"
    flags = ("-O2", "-ffp-contract=on", *request.param)
    contents = library_sources(library.sources) | {"main.c": PROGRAM.read_bytes(), "rows.h": rows.encode()}
    shared_builds.compile_c(contents, path, compiler=COMPILER, flags=flags)
    return request.param is DOT_PRODUCTS, path


def test_dot_products_are_where_they_may_be(program):
    """SDOT by element: 0100 1111 10.. .... 1110 .0.. .... ...."""
    may, path = program
    content = path.read_bytes()
    words = np.frombuffer(content[: len(content) // 4 * 4], dtype="<u4")
    assert np.any((words & 0xFFC0F400) == 0x4F80E000) == may


@pytest.mark.skipif(EMULATOR is None, reason="qemu-aarch64 (Debian's qemu-user) is not installed")
def test_answers_are_the_hosts(program, library):
    """To the bit where the host fuses products, too; else within what unfused roundings move an action by."""
    assert EMULATOR is not None
    done = subprocess.run([EMULATOR, "-cpu", "max", program[1]], capture_output=True, check=True)
    horizon, window = library.sizes.horizon, library.sizes.window
    found = np.frombuffer(done.stdout, dtype="<f4").reshape(len(library.rows) - window + 1, -1)[:, :horizon]
    flags = ("-O2", "-ffp-contract=on", "-march=native")
    host = CController(library.sources, library.sizes, compiler=COMPILER, flags=flags)
    plan, expected = np.zeros(horizon), []
    for end in range(window, len(library.rows) + 1):
        plan = host.control_step(library.rows[end - window : end].astype(np.float64), plan, np.ones(horizon)).plan
        expected.append(plan)
    processor = Path("/proc/cpuinfo")
    fuses = platform.machine() == "aarch64" or (processor.exists() and " fma " in processor.read_text())
    np.testing.assert_allclose(found, np.array(expected), rtol=0, atol=0 if fuses else 2.5e-5)
