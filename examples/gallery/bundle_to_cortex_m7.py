r"""
From a bundle to a Cortex-M7
============================

For ECU engineers who want to know the memory and time that a release needs on a microcontroller before they have a
board. At the end you have the C sources of the shipped release, their memory, and the modelled time of a control step
and its parts.

The core is emulated, and its time is modelled. The last section states the limits of the model.
"""

# sphinx_gallery_thumbnail_number = 2

# %%
# From the bundle to C
# --------------------
# On the command line, ``stillwake export --c FOLDER`` writes the release's controller and the whole ECU as freestanding
# C99 without allocation. It writes the folder only if the library agrees with the reference computation and has the
# same program as the signed bundle.

import tempfile
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
from rich import print

from contract.config.loading import load_config
from contract.controller.c_folder import EXPECTED, ProgramSettings, read_recorded, read_sources
from stillwake.parts.c_release import write_shipped_library
from stillwake.parts.releases import open_release

release = open_release(None)
config = load_config()
with tempfile.TemporaryDirectory() as folder:
    write_shipped_library(Path(folder), release, config)
    sources, recorded = read_sources(Path(folder)), read_recorded(Path(folder))
    expected = Path(folder, EXPECTED).read_text(encoding="utf-8").splitlines()
for name in ("sw_control_step.c", "sw_encoder.c", "sw_dynamics.c", "sw_decoder.c", "sw_weights.c", "sw_ecu.c"):
    print(f"{name:20s} {len(sources[name]) / 1024:7.1f} KiB of text")

# %%
# Onto the core
# -------------
# The sources are compiled for a bare Cortex-M7 and put into the flash of an emulated core. The core gets recorded
# pressures, row by row, until the controller's window is full; then it computes one control step. ``expected.txt`` in
# the folder has the action that the same library computed on a computer. The computer's compiler settings
# round sums differently. With equal settings, core and computer agree to the bit; ``stillwake mcu`` checks every row.

from firmware_sim.mcu.build import CORTEX_M7, compile_for_cortex_m7, read_elf
from firmware_sim.mcu.emulator import Machine

settings = ProgramSettings.of(sources)
firmware = read_elf(compile_for_cortex_m7(sources))
machine = Machine(firmware)
counter = machine.block_counter(CORTEX_M7)
machine.call("mcu_reset")
window = settings.number("SW_WINDOW")
for row in recorded[: window - 1]:
    machine.write("mcu_row", row.astype("<f4").tobytes())
    machine.call("mcu_push")
machine.write("mcu_row", recorded[window - 1].astype("<f4").tobytes())
machine.paint_stack()
counter.start()
machine.call("mcu_step")
stack = machine.stack_depth()

action = np.frombuffer(machine.read("mcu_output", 4), dtype="<f4")[0]
answer = float(expected[0].split()[0])
limit = release.manifest.action_limit
difference = 100 * abs(action - answer) / limit
print(f"action on the core {action:.5f}, on a computer {answer:.5f}: apart by {difference:.2f} % of its limit")

# %%
# Memory
# ------
# The flash contains code and weights. The RAM contains the workspace, the stack, and a copy of the dynamics' weights,
# because every iteration reads these weights.

parts = {
    "code": (firmware.sections[".text"], "#2b6ca3"),
    "weights, tables": (firmware.sections[".rodata"], "#a3562b"),
    "dynamics": (firmware.sections[".hot"], "#3b7d3b"),
    "workspace": (firmware.sections.get(".data", 0) + firmware.sections[".bss"], "#6b4a8f"),
    "stack": (stack, "#555555"),
}
figure, axis = plt.subplots(figsize=(8, 2.2), layout="constrained")
for place, names in (("flash", ("code", "weights, tables", "dynamics")), ("RAM", ("dynamics", "workspace", "stack"))):
    left = 0.0
    for part in names:
        size, colour = parts[part][0] / 1024, parts[part][1]
        bar = axis.barh(place, size, left=left, color=colour, edgecolor="white")
        if size > 4.0:
            axis.bar_label(bar, [f"{part}\n{size:.1f}"], label_type="center", fontsize=8, color="white")
        left += size
    axis.annotate(f"{left:.1f} KiB", (left + 0.5, place), va="center")
axis.set(xlabel="KiB", xlim=(0, 85))
axis.invert_yaxis()
plt.show()
print(f"stack: {stack} B")

# %%
# Time
# ----
# The emulator counts how often each basic block runs. A model of the core's dual-issue pipeline gives the cycles.
# The control period is 20 ms at the default operating point.

from bisect import bisect_right
from collections import Counter

from rich.table import Table

starts = sorted((address & ~1, name) for name, address in firmware.symbols.items() if not name.startswith("$"))
addresses = [address for address, _ in starts]
cycles: Counter[str] = Counter()
instructions = 0
for address, block_instructions, block_cycles in counter.blocks():
    cycles[starts[bisect_right(addresses, address) - 1][1]] += block_cycles
    instructions += block_instructions
period_ms = config.period_ns / 1e6
table = Table("one control step", "")
table.add_row("multiply-accumulates", f"{settings.multiply_accumulates() / 1e6:.2f} M")
table.add_row("instructions", f"{instructions / 1e6:.2f} M")
table.add_row("modelled cycles", f"{cycles.total() / 1e6:.2f} M")
for clock in CORTEX_M7.clocks_mhz:
    step_ms = cycles.total() / (clock * 1e3)
    table.add_row(f"at {clock} MHz", f"{step_ms:.1f} ms, {100 * step_ms / period_ms:.0f} % of the period")
print(table)

# %%
# Where the time goes
# -------------------
# A control step encodes the window once. Then each iteration computes the plan's effect with the dynamics, decodes the
# forces, and computes the gradient of the cost backwards. Forward computations are blue, backward ones red.

longest = [(name, count / 480e3) for name, count in cycles.most_common() if count > 0.002 * cycles.total()]
figure, axis = plt.subplots(figsize=(8, 3.2), layout="constrained")
bars = axis.barh(
    [name for name, _ in longest],
    [step_ms for _, step_ms in longest],
    color=["tab:red" if "adjoint" in name or "gradient" in name else "tab:blue" for name, _ in longest],
)
axis.bar_label(bars, fmt="%.2f ms", padding=3, fontsize=8)
axis.invert_yaxis()
axis.margins(x=0.12)
axis.set_xlabel("modelled time at 480 MHz / ms   (blue: forward, red: back)")
plt.show()

# %%
# What this page does not show
# ----------------------------
# Arm publishes no cycle counts of this core. The model is this project's own; nothing was measured on a real core. The
# model assumes that code, tables and the decoder's weights are in the caches, and everything else is in tightly coupled
# memory. A chip without such memory is slower. The number of instructions is exact, and does not depend on data.
#
# This page shows only the control step. The ECU's protection, fail-safe, sensor check and command gate need more time.
# ``stillwake run runs/m7 --ecu mcu`` runs the ECU in the closed loop with its modelled time, and the page
# :doc:`Integrate the ECU in C </how-to/integrate-the-ecu>` has the ECU's memory and longest time. ``stillwake mcu``
# prints these figures for any library and compares all recorded rows.
