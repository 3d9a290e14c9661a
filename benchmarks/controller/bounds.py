"""The bounds of the firmware: the passes of each loop, the targets of calls through pointers, and the stack. The check
also ensures that there is no recursion.

    python -m benchmarks bounds --json results/bounds.json

The shipped release's firmware is checked with loader, diagnosis, calibration and a key of the bus. GCC proves the
bounds of most loops (`benchmarks.controller.whole_program`); `bounds.toml` states the reason for each bound that GCC
does not prove. An unknown loop, a recursion, or a call through a pointer that reaches no known function is an error.
"""

import io
import tomllib
from collections.abc import Mapping
from dataclasses import replace
from graphlib import CycleError, TopologicalSorter
from pathlib import Path
from typing import Any, Final

import capstone
from elftools.elf.elffile import ELFFile

from benchmarks.common.command_line import JsonFile, report
from benchmarks.controller import tables
from benchmarks.controller.whole_program import Built, Calls, Loop, WholeProgram, gcc_version, read_built, read_program
from benchmarks.controller.worst_period import KEY_BYTES, worst_periods
from contract.config.loading import load_config
from contract.controller.c_folder import ECU_SETTINGS, read_recorded, read_sources
from contract.errors import McuError
from contract.release.bundle import load as load_bundle
from contract.release.signing import project_key
from contract.results import versions
from contract.shipped import BUNDLE
from ecu.in_c.c_settings import ecu_settings
from firmware_sim.mcu.build import BUS_KEY, EQUIPMENT, board_files, bus_key_header, equipment_header, read_elf
from stillwake.parts.c_release import library_folder

REASONS: Final = Path(__file__).with_name("bounds.toml")
LARGEST_PROVED: Final = 4095
"""Largest proved number of passes that is accepted from GCC. A larger number only reflects the range of a type or the
size of the memory, so such a loop needs a reason in `bounds.toml`."""
EXCEPTION_FRAME: Final = 108
"""Bytes that the core pushes for an exception, including floating-point registers and alignment (Armv7-M, B1.5.6)."""
_EXCEPTIONS: Final = ("sw_board_unexpected", "sw_board_tick")
"""Names of the handlers in the vector table. Interrupts are masked, but a fault or an NMI can still occur."""
_START: Final = "sw_board_start"


def main(json_file: JsonFile = None) -> None:
    """Report the bounds of the firmware with all its parts. For the release's firmware, which has no loader and no key,
    also report the bound and the measured depth of the stack."""
    config, bundle = load_config(), load_bundle(BUNDLE)
    with library_folder(None) as folder:
        sources, rows = read_sources(folder, board=True), read_recorded(folder)
    keyed = replace(config, bus=replace(config.bus, key="bus.key"))
    fullest = {**sources, ECU_SETTINGS: ecu_settings(bundle, keyed)}
    # The values of the keys do not change the code.
    header = equipment_header(project_key(), bytes(1), bytes(1), "h", "s")
    own = {EQUIPMENT: header, BUS_KEY: bus_key_header(KEY_BYTES)}
    found = bounds(read_program(board_files(fullest, own)))
    alone = read_built(board_files(sources))
    drives = ("full bus", "a sensor left out")
    measured = worst_periods(sources, config, rows, firmware=read_elf(alone.image), drives=drives)
    stacks = {"stack_b": stack_of(alone)[0], "measured_stack_b": measured["stack_b"]}
    found["alone"] = {**stacks, "worst_ms": measured["worst_ms"], "bound_ms": measured["bound_ms"]}
    facts = {"compiler": gcc_version(), "versions": versions("unicorn", "capstone")}
    report(json_file, found, facts, tables.bounds)


def bounds(program: WholeProgram, reasons: Mapping[str, Any] | None = None) -> dict[str, Any]:
    """Check a firmware. Raises McuError, which lists every loop without a bound, a recursion and every unresolved call.
    Returns:

    - loops: a line for each loop: function, line in the source, largest number of passes, and the reason for it
    - proved, reasoned, waits: numbers of loops whose bound GCC proves, whose bound `reasons` (default: `bounds.toml`)
      states, and that have no bound by design
    - functions, pointed_at: number of all functions, and number of functions called through pointers
    - stack_b, stack_of: largest stack in bytes, including an exception, and the chain of calls that needs it
    """
    known = tomllib.loads(REASONS.read_text(encoding="utf-8")) if reasons is None else reasons
    lines = {loop: _line(loop, known) for loop in program.loops}
    wrong = [f"{loop.function}: the loop at {loop.place} has no bound" for loop, line in lines.items() if line is None]
    left = {**known["most"], **known["waits"]}.keys() - {loop.function for loop in program.loops}
    wrong += [f"{name}: has a reason in {REASONS.name}, but no loop" for name in sorted(left)]
    for calls in (program.written, program.built.calls):
        if circle := recursion(calls):
            wrong.append(f"{' calls '.join(circle)}: recursion")
        wrong += [f"{place}: a call through a pointer reaches no known function" for place in calls.unresolved]
    if wrong:
        raise McuError("; ".join(wrong))
    depth, chain = stack_of(program.built)
    kinds = [loop.function in known["waits"] if _is_open(loop) else None for loop in program.loops]
    return {
        "loops": sorted(line for line in lines.values() if line is not None),
        "proved": kinds.count(None),
        "reasoned": kinds.count(False),
        "waits": kinds.count(True),
        "functions": len(program.written.stack),
        "pointed_at": len(program.pointed_at),
        "stack_b": depth,
        "stack_of": chain,
    }


def recursion(calls: Calls) -> list[str]:
    """Return a circular chain of calls, which starts and ends with the same function; empty if there is none."""
    try:
        TopologicalSorter(calls.calls).prepare()
    except CycleError as error:
        return list(reversed(error.args[1]))
    return []


def deepest(calls: Calls, start: str, runtime: int) -> tuple[int, list[str]]:
    """Return the largest stack in bytes that a function needs with all its callees, and the chain of calls that needs
    this stack. There must be no recursion. A function of the compiler's runtime needs `runtime` bytes."""
    known = dict[str, tuple[int, list[str]]]()
    for name in TopologicalSorter(calls.calls).static_order():
        under = max((known[called] for called in calls.calls.get(name, ())), default=(0, []))
        known[name] = calls.stack.get(name, runtime) + under[0], [name, *under[1]]
    return known[start]


def stack_of(built: Built) -> tuple[int, list[str]]:
    """Return the largest stack of a firmware in bytes, if an exception occurs at the worst place, and the chain of
    calls that leads to this place."""
    runtime = _stack_of_runtime(built)
    named = {name.split(" ")[0]: name for name in built.calls.stack}
    depth, chain = deepest(built.calls, named[_START], runtime)
    handler = max(deepest(built.calls, named[name], runtime)[0] for name in _EXCEPTIONS)
    return depth + EXCEPTION_FRAME + handler, chain


def _is_open(loop: Loop) -> bool:
    return loop.most is None or loop.most > LARGEST_PROVED


def _line(loop: Loop, known: Mapping[str, Any]) -> str | None:
    """Return a loop's line for the table; None if the loop's bound is not known."""
    what = f"{loop.function} {loop.place.rpartition(':')[2]}"
    if not _is_open(loop):
        return f"{what}: {loop.most}"
    if loop.function in known["waits"]:
        return f"{what}: waits: {known['waits'][loop.function]}"
    if loop.function in known["most"]:
        most, why = known["most"][loop.function]
        return f"{what}: {most}: {why}"
    return None


def _stack_of_runtime(built: Built) -> int:
    """Return the largest stack, in bytes, among the compiler's runtime functions that are called. GCC reports no stack
    for these functions, so their instructions are analysed. This largest stack is used for each of these functions,
    because a function may jump into another."""
    called = {name for names in built.calls.calls.values() for name in names} - built.calls.stack.keys()
    elf: Any = ELFFile(io.BytesIO(built.image))
    text, table = elf.get_section_by_name(".text"), next(iter(elf.iter_sections("SHT_SYMTAB")))
    functions = (item for item in table.iter_symbols() if item["st_info"]["type"] == "STT_FUNC")
    addresses = {item.name: item["st_value"] & ~1 for item in functions}
    starts = sorted(set(addresses.values()))
    machine = capstone.Cs(capstone.CS_ARCH_ARM, capstone.CS_MODE_THUMB + capstone.CS_MODE_MCLASS)
    machine.skipdata = True

    def stack(start: int, seen: frozenset[int]) -> int:
        end = next((other for other in starts if other > start), text["sh_addr"] + text["sh_size"])
        lines = list(machine.disasm(text.data()[start - text["sh_addr"] : end - text["sh_addr"]], start))
        targets = {int(line.op_str[1:], 0) & ~1 for line in lines if line.op_str.startswith("#")}
        others = targets & set(starts) - seen - {start}
        return sum(map(_pushed, lines)) + max((stack(other, seen | {start}) for other in others), default=0)

    return max((stack(addresses[name], frozenset()) for name in called & addresses.keys()), default=0)


def _pushed(line: Any) -> int:
    """Return the bytes by which an instruction (`push`, `str ..., [sp, #-n]!`, or `sub sp, #n`) extends the stack."""
    name, text = str(line.mnemonic), str(line.op_str)
    if name.startswith("push"):
        return 4 * (text.count(",") + 1)
    if ("[sp, #-" in text and text.endswith("!")) or (name.startswith("sub") and text.startswith("sp,")):
        return int(text.rpartition("#")[2].strip("-]!"), 0)
    return 0
