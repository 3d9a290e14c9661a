"""The controller on an emulated Cortex-M7: the host's numbers to the bit, and budgets that a change may not exceed."""

import platform
from importlib.resources import files
from pathlib import Path

import numpy as np
import pytest
import unicorn

from contract.config.controller import MpcConfig
from contract.config.learning import ModelConfig
from contract.controller.c_folder import RECORDED, ProgramSettings, read_recorded, read_sources
from contract.errors import LibraryError, McuError
from examples.random_programs import random_program
from export.program.controller_program import ControllerProgram, random_window
from export.release.pipeline import rows_of
from export.to_c.library import c_library, int8_library
from firmware_sim.mcu import measure as mcu
from firmware_sim.mcu.build import CORTEX_M4F, CORTEX_M7, compile_for_cortex_m7, read_elf
from firmware_sim.mcu.emulator import Machine
from firmware_sim.mcu.measure import verdicts
from firmware_sim.mcu.pipeline import Pipeline

SMALL = ModelConfig(window=6, latent=3, lstm_width=5, dynamics_width=12, decoder_width=8)
UNEVEN = ModelConfig(window=6, latent=5, lstm_width=13, dynamics_width=29, decoder_width=19)
ODD = random_program(1, model=UNEVEN, mpc=MpcConfig(horizon=7))


def sources_and_rows(program: ControllerProgram, precision: str, steps: int = 4) -> tuple[dict[str, bytes], np.ndarray]:
    rng = np.random.default_rng(0)
    series = np.concatenate([random_window(program, rng) for _ in range(2)])
    windows = [series[i : i + program.window] for i in range(steps)]
    sources = c_library(program) if precision == "float32" else int8_library(program, windows)
    return sources, rows_of(windows).astype(np.float32)


def agrees(measured: mcu.Measurement) -> bool:
    """Integer products agree to the bit whatever the instructions; so do floats where the host fuses, too. The bound is
    what unfused roundings may move an action by, as in the parity tests."""
    processor = Path("/proc/cpuinfo")
    fuses = platform.machine() == "aarch64" or (processor.exists() and " fma " in processor.read_text())
    return measured.identical if fuses else measured.action_difference <= 2.5e-5


@pytest.mark.mcu
def test_a_core_that_takes_small_numbers_as_zero_gives_no_plan():
    """The mode FZ of its FPU; nor with another rounding."""
    sources, rows = sources_and_rows(random_program(1, model=SMALL, mpc=MpcConfig(horizon=7)), "float32")
    begin, own = b"int mcu_step(void)\n{\n", files("firmware_sim").joinpath("mcu/c/mcu.c").read_bytes()
    mode = b'    __asm__ volatile("vmsr fpscr, %0" : : "r"(mcu_mode));\n'
    assert own.count(begin) == 1
    planted = own.replace(begin, b"extern unsigned mcu_mode;\nunsigned mcu_mode;\n" + begin + mode)
    machine = Machine(read_elf(compile_for_cortex_m7(sources, {"mcu.c": planted})))
    machine.call("mcu_reset")
    machine.write("mcu_row", rows[0].astype("<f4").tobytes())
    for fpscr, status in ((0, 0), (1 << 24, 2), (1 << 22, 2), (0, 0)):
        machine.write("mcu_mode", fpscr.to_bytes(4, "little"))
        assert machine.call("mcu_step") == status, fpscr


@pytest.mark.mcu
def test_the_core_computes_what_the_host_does_also_at_odd_sizes_and_leaves_room_for_the_ecu():
    """The whole ECU may have 12 ms, 144 KiB of flash, 64 KiB of RAM and 1 KiB of stack. Instructions are exact for this
    compiler, so four hundredths of room are enough for another one. The size is above the release's 64/32: 96-wide
    dynamics, 64-wide decoder, 25 steps, int8."""
    program = random_program(0, model=ModelConfig(dynamics_width=96, decoder_width=64), mpc=MpcConfig(iterations=3))
    budgeted = mcu.measure(*sources_and_rows(program, "int8", steps=2))
    assert budgeted.flash_bytes <= 106 * 1024
    assert budgeted.ram_bytes <= 55 * 1024
    assert budgeted.stack_bytes <= 512
    assert budgeted.instructions <= 8.3e6
    assert budgeted.cycles <= 5.2e6
    odd = mcu.measure(*sources_and_rows(ODD, "float32"))
    assert (budgeted.steps, budgeted.precision, odd.precision) == (2, "int8", "float32")
    assert agrees(budgeted) and agrees(odd)


@pytest.mark.mcu
@pytest.mark.proofs  # another core is another library of the compiler's
def test_a_core_that_issues_one_instruction_a_cycle_runs_the_same_ones():
    """But for a few, none of them side by side, and loads take two cycles."""
    faster, slower = (mcu.measure(*sources_and_rows(ODD, "int8"), core=core) for core in (CORTEX_M7, CORTEX_M4F))
    assert agrees(faster) and faster.precision == "int8"
    assert slower.instructions == pytest.approx(faster.instructions, rel=0.03)
    assert slower.instructions < slower.cycles < 2.2 * faster.cycles
    assert set(slower.modelled_ms) == {"170"}


def test_multiply_accumulates_are_those_of_the_layers():
    """Counted by hand for a tiny net: encoder 6 rows of 4 x 5 gates over 5 + 5 inputs, head 5 x 5, latent 3 x 5;
    dynamics 12 x 4 + 12 x 12 + 12 x 3 = 228 and decoder 8 x 3 + 2 x 8 x 8 + 2 x 8 = 168, each 2 x 2 + 1 times over 4
    steps."""
    program = random_program(0, model=SMALL, mpc=MpcConfig(horizon=4, iterations=2))
    expected = 6 * 20 * 10 + 25 + 15 + 5 * 4 * (228 + 168)
    assert ProgramSettings.of(c_library(program)).multiply_accumulates() == expected


@pytest.mark.mcu
def test_counting_blocks_counts_every_instruction():
    sources, _ = sources_and_rows(random_program(0, model=SMALL, mpc=MpcConfig(horizon=4)), "int8")
    machine = Machine(read_elf(compile_for_cortex_m7(sources)))
    counter = machine.block_counter()
    machine.call("mcu_reset")
    counter.start()
    machine.call("mcu_step")
    counted, _ = counter.total()

    core = machine._core
    single = 0

    def tick(*_: object) -> None:
        nonlocal single
        single += 1

    # The same call again, from the same start: some comparisons of the cost depend on the plan.
    machine.call("mcu_reset")
    core.ctl_flush_tb()
    core.hook_add(unicorn.UC_HOOK_CODE, tick)
    machine.call("mcu_step")
    # The hook does not see conditional instructions that are skipped; the core spends their time all the same. They are
    # in the cost and at the ends of the window, a few hundred whatever the widths.
    assert 0 <= counted - single < 2e-3 * single


def test_the_verdict_names_the_factor():
    for needed, said in ((55.9, "DOES NOT FIT: 2.8 times the period"), (20.0, "fits: 100 %"), (5.0, "fits: 25 %")):
        rows = dict(verdicts({"480": needed}, 20.0))
        assert rows["control period"].startswith("20 ms"), needed
        assert rows["at 480 MHz, by the model"].startswith(said), needed


def test_the_pipeline_model_keeps_its_rules():
    for code, cycles, why in [
        ("0120 0221", 1, "two independent moves go together"),
        ("0120 401c", 2, "MOVS r0, #1; ADDS r0, r0, #1: the second needs the first"),
        ("0868 401c", 3, "LDR r0, [r1]; ADDS r0, r0, #1: a load's result comes after two cycles"),
        ("20fb0013 20fb0024", 2, "two multiplications do not go together"),
        ("0120 7047", 2, "a branch costs one cycle more"),
    ]:
        raw = bytes.fromhex(code.replace(" ", ""))
        assert Pipeline(raw, 0).block(0, len(raw))[1] == cycles, why


def test_what_cannot_be_measured_is_refused(tmp_path):
    with pytest.raises(LibraryError, match=r"recorded\.txt"):
        mcu.measure(read_sources(tmp_path), read_recorded(tmp_path))
    (tmp_path / RECORDED).write_text("1 2 3 4 5\n")
    with pytest.raises(LibraryError, match=r"sw_settings.h is missing"):
        mcu.measure(read_sources(tmp_path), read_recorded(tmp_path))
    sources, rows = sources_and_rows(random_program(0, model=SMALL, mpc=MpcConfig(horizon=4)), "float32")
    with pytest.raises(McuError, match="at least 6 rows of 5"):
        mcu.measure(sources, rows[:5])
    with pytest.raises(McuError, match=r"compiling for the microcontroller failed: .*error"):
        mcu.measure(sources | {"sw_cost.c": b"#error broken\n"}, rows)
    for image, reason in [(b"import this", "Magic number"), (b"\x7fELF\x02\x01\x01", "expected")]:
        with pytest.raises(McuError, match=f"not a 32-bit little-endian ELF file: .*{reason}"):
            read_elf(image)
