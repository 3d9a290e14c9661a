"""The emulated core against QEMU's Cortex-M7 (machine mps2-an500): the same outputs to the bit, the same instructions.

Both run the same library, linked for other addresses, on other start-up code. Unicorn descends from an older QEMU, so
this is a second version and a second way to start, load and count rather than an independent core.
"""

import shutil
import subprocess
from importlib.resources import files
from pathlib import Path

import numpy as np
import pytest

from contract.config.controller import MpcConfig
from contract.config.learning import ModelConfig
from examples.random_programs import random_program
from export.program.random_windows import random_window
from export.release.lowering import int8_library
from export.to_c.library import c_library

pytest.importorskip("unicorn", reason="unicorn (extra mcu) is not installed")
pytest.importorskip("capstone", reason="capstone (extra mcu) is not installed")
pytest.importorskip("elftools", reason="pyelftools (extra mcu) is not installed")
pytest.importorskip("ziglang", reason="ziglang (extra mcu) is not installed")

from firmware_sim.mcu.build import LINKER_SCRIPT, compile_for_cortex_m7
from firmware_sim.mcu.elf import read_elf
from firmware_sim.mcu.emulator import FLASH, Machine
from firmware_sim.mcu.pipeline import Pipeline

QEMU = shutil.which("qemu-system-arm") or ""
pytestmark = [pytest.mark.mcu, pytest.mark.skipif(not QEMU, reason="qemu-system-arm is not installed")]

MODEL = ModelConfig(window=6, latent=5, lstm_width=13, dynamics_width=29, decoder_width=19)
STEPS = 3
TICK = 40
"""Instructions a tick of SysTick, which counts the board's 25 MHz: QEMU is told to take 1 ns an instruction."""

BOARD = r"""
#include <stdint.h>
#include "stillwake.h"
#include "rows.h"

extern float mcu_row[SW_COLUMNS];
extern sw_output mcu_output;
void mcu_reset(void);
int mcu_push(void);
int mcu_step(void);
void board_reset(void);
void board_run(void);

#define REGISTER(address) (*(volatile uint32_t *)(address))

static void host(int operation, const void *argument)
{
    register int r0 __asm__("r0") = operation;
    register const void *r1 __asm__("r1") = argument;
    __asm__ volatile("bkpt 0xab" : "+r"(r0) : "r"(r1) : "memory");
}

static void print_word(uint32_t word)
{
    char text[10];
    for (int i = 0; i < 8; i++) text[i] = "0123456789abcdef"[word >> (28 - 4 * i) & 15];
    text[8] = '\n';
    text[9] = 0;
    host(0x04, text);
}

void board_run(void)
{
    REGISTER(0xe000e014) = 0xffffff;
    REGISTER(0xe000e018) = 0;
    REGISTER(0xe000e010) = 5;
    mcu_reset();
    for (int row = 0; row < ROWS; row++) {
        for (int i = 0; i < SW_COLUMNS; i++) mcu_row[i] = rows[row][i];
        if (row + 1 < SW_WINDOW) {
            mcu_push();
            continue;
        }
        const uint32_t before = REGISTER(0xe000e018);
        const int status = mcu_step();
        const uint32_t after = REGISTER(0xe000e018);
        print_word((uint32_t)status);
        print_word((before - after) & 0xffffff);
        for (size_t i = 0; i < sizeof mcu_output / 4; i++) print_word(((const uint32_t *)&mcu_output)[i]);
    }
    host(0x18, (const void *)0x20026);
}

void board_reset(void)
{
    REGISTER(0xe000ed88) |= 0xfu << 20;
    __asm__ volatile("dsb\n isb\n b board_run");
}

__attribute__((section(".vectors"), used)) static const void *const vectors[] = {
    (const void *)0x20080000, (const void *)board_reset,
};
"""


def board(rows: np.ndarray) -> dict[str, bytes]:
    """Start-up and linker script for mps2-an500, whose code memory is at 0 and whose data memory is at 0x20000000."""
    script = files("firmware_sim").joinpath("mcu/c", LINKER_SCRIPT).read_text()
    for old, new in (
        ("ORIGIN = 0x08000000", "ORIGIN = 0x00000000"),
        ("KEEP(*(.text.mcu_reset))", "KEEP(*(.vectors)) KEEP(*(.text.mcu_reset))"),
    ):
        assert old in script
        script = script.replace(old, new)
    values = ",\n".join("{" + ", ".join(f"{float(value).hex()}f" for value in row) + "}" for row in rows)
    header = f"#define ROWS {len(rows)}\nstatic const float rows[ROWS][SW_COLUMNS] = {{\n{values}}};\n"
    return {LINKER_SCRIPT: script.encode(), "board.c": BOARD.encode(), "rows.h": header.encode()}


@pytest.mark.parametrize("precision", ["float32", "int8"])
def test_qemu_computes_and_counts_the_same(precision, tmp_path: Path):
    program = random_program(1, model=MODEL, mpc=MpcConfig(horizon=7))
    rng = np.random.default_rng(0)
    series = np.concatenate([random_window(program, rng) for _ in range(2)])
    windows = [series[i : i + program.window] for i in range(4)]
    sources = c_library(program) if precision == "float32" else int8_library(program, windows)
    rows = series[: program.window + STEPS - 1].astype("<f4")

    image = tmp_path / "board.elf"
    image.write_bytes(compile_for_cortex_m7(sources, board(rows)))
    command = [QEMU, "-M", "mps2-an500", "-nographic", "-monitor", "none", "-serial", "none", "-icount", "shift=0"]
    command += ["-semihosting-config", "enable=on,target=native", "-kernel", str(image)]
    done = subprocess.run(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, timeout=300, check=True)
    words = np.array([int(word, 16) for word in done.stdout.split()], dtype="<u4").reshape(STEPS, -1)
    assert not words[:, 0].any()

    machine = Machine(read_elf(compile_for_cortex_m7(sources)))
    pipeline = Pipeline(machine.code(), FLASH)
    machine.call("mcu_reset")
    for i, row in enumerate(rows, start=1):
        machine.write("mcu_row", row.tobytes())
        if i < program.window:
            machine.call("mcu_push")
            continue
        blocks = machine.call_counted("mcu_step")
        _, ticks, *output = words[i - program.window]
        assert machine.read("mcu_output", 4 * len(output)) == np.array(output, dtype="<u4").tobytes()
        counted = sum(count * pipeline.block(*place).instructions for place, count in blocks.items())
        # The call, the clock's own reading, and a tick at either end come on top.
        assert abs(int(ticks) * TICK - counted) < 2e-3 * counted + 4 * TICK
