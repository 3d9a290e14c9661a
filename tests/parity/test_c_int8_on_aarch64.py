"""The int8 library on an emulated AArch64 processor: the host's answers to the bit, by every kind of product."""

import platform
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest

from contract.config.controller import MpcConfig
from contract.config.learning import ModelConfig
from contract.controller.c_folder import rows_text
from contract.controller.compiler import zig_compiler
from export.program.random_program import random_program, random_window
from export.release.lowering import int8_library

EMULATOR = shutil.which("qemu-aarch64") or shutil.which("qemu-aarch64-static")
COMPILER = zig_compiler()
PLAIN = ("-target", "aarch64-linux-musl", "-mcpu=cortex_a72")
DOT_PRODUCTS = ("-target", "aarch64-linux-musl", "-mcpu=cortex_a76")

pytestmark = [
    pytest.mark.compiler,
    pytest.mark.skipif(COMPILER is None, reason="ziglang (extra mcu) is not installed"),
]


@pytest.fixture(scope="module")
def sources_and_rows() -> tuple[dict[str, bytes], bytes]:
    """A net whose layers are no whole tiles, and rows of which some drive activations to the ends of 16 bits."""
    model = ModelConfig(window=6, latent=5, lstm_width=13, dynamics_width=29, decoder_width=19)
    program = random_program(1, model=model, mpc=MpcConfig(horizon=7))
    rng = np.random.default_rng(0)
    windows = [random_window(program, rng) for _ in range(4)]
    return int8_library(program, windows), rows_text(np.concatenate([*windows, 8.0 * windows[0]])).encode()


def answers(folder: Path, shared_builds, sources: dict[str, bytes], rows: bytes, flags: tuple[str, ...], *run: str):
    program = folder / "replay"
    shared_builds.compile_c(sources, program, compiler=COMPILER, flags=("-O2", "-ffp-contract=on", *flags))
    done = subprocess.run([*run, program], input=rows, capture_output=True, check=True)
    return done.stdout


def test_dot_products_are_in_the_program(tmp_path, shared_builds, sources_and_rows):
    """SDOT's opcode, by lane: 0100 1111 10.. .... 1110 .0.. .... ....; it must not be in the other build."""
    found = []
    for flags in (PLAIN, DOT_PRODUCTS):
        path = tmp_path / "library.o"
        shared_builds.compile_c(sources_and_rows[0], path, compiler=COMPILER, flags=("-O2", "-ffp-contract=on", *flags))
        words = np.frombuffer(path.read_bytes()[: path.stat().st_size // 4 * 4], dtype="<u4")
        found.append(int(np.sum((words & 0xFFC0F400) == 0x4F80E000)))
    assert found[0] == 0
    assert found[1] > 0


@pytest.mark.skipif(EMULATOR is None, reason="qemu-aarch64 (Debian's qemu-user) is not installed")
def test_answers_are_the_hosts_to_the_bit(tmp_path, shared_builds, sources_and_rows):
    sources, rows = sources_and_rows
    plain = answers(tmp_path, shared_builds, sources, rows, PLAIN, EMULATOR)
    assert len(plain.splitlines()) == 25
    assert answers(tmp_path, shared_builds, sources, rows, DOT_PRODUCTS, EMULATOR, "-cpu", "max") == plain
    processor = Path("/proc/cpuinfo")
    if platform.machine() == "aarch64" or (processor.exists() and " fma " in processor.read_text()):
        assert answers(tmp_path, shared_builds, sources, rows, ("-march=native",)) == plain
