"""The cycles of a basic block on a Cortex-M7 or a Cortex-M4, from models of their pipelines.

Arm publishes no cycle counts for the Cortex-M7, so its model makes these assumptions:

- Instructions issue in order, up to two per cycle, when both are ready. At most one instruction of a pair may multiply,
  use the floating-point unit, access memory, or branch, but two single loads may form a pair. Multiple loads or stores
  issue alone. The second instruction of a pair may write a register that the first one reads.
- A result of the integer unit or of a floating-point move can be used one cycle later. After a load or a multiplication
  this takes two cycles (one if a multiply-accumulate adds to the product), after other floating-point operations three,
  and after a fused multiply-add four cycles. Divisions take 14 cycles and block their unit.
- A block that ends in a branch takes one more cycle; branches are predicted correctly.
- Every memory access is a hit: code is in instruction TCM or cache, workspace and the dynamics' weights are in data
  TCM, and all other constants are in a warm data cache.

A Cortex-M4 issues one instruction per cycle, from memories without wait states (Arm's table of its cycles, DDI 0439):

- A load takes two cycles, or one cycle directly after a load or store. A double or multiple load or store takes one
  cycle for each word, plus one cycle. A fused multiply-add takes three cycles, a division 14, and every other
  instruction one.
- A block that ends in a branch takes two more cycles.
"""

from functools import cache
from typing import Any, Final

import capstone

_DIVIDE_CYCLES: Final = 14
_FUSED: Final = ("vfm", "vfnm", "vmla", "vmls", "vnml")
_KINDS: Final = (
    (("vdiv", "vsqrt", "sdiv", "udiv"), ("divide", _DIVIDE_CYCLES, 1)),
    # A multiple load or store moves two words per cycle. The firmware's longest moves about eight in four cycles.
    (("ldm", "stm", "vldm", "vstm", "push", "pop", "vpush", "vpop", "strd"), ("many", 2, 4)),
    (("ldrd",), ("double", 2, 1)),
    (("ldr", "vldr"), ("load", 2, 1)),
    (("str", "vstr"), ("store", 1, 1)),
    (("smla", "smul", "smmul", "mla", "mls", "mul", "umull", "smull", "umlal", "smlal"), ("multiply", 2, 1)),
    (_FUSED, ("float", 4, 1)),
    (("vmov", "vabs", "vneg", "vsel"), ("float", 1, 1)),
    (("v",), ("float", 3, 1)),
)
"""The beginnings of mnemonics in the order in which they are tried, each with the result of `_kind`."""


class Pipeline:
    """A model of the cycles of machine code at `origin`, on a Cortex-M7, or on a Cortex-M4 if `dual_issue` is False."""

    def __init__(self, code: bytes, origin: int, *, dual_issue: bool = True) -> None:
        self._code, self._origin = code, origin
        self._cycles = _cycles if dual_issue else _cycles_one_by_one
        self._disassembler = capstone.Cs(capstone.CS_ARCH_ARM, capstone.CS_MODE_THUMB | capstone.CS_MODE_MCLASS)
        self._disassembler.detail = True

    def block(self, address: int, size: int) -> tuple[int, int]:
        """Return the number of instructions and the modelled cycles of the block of `size` bytes at `address`."""
        start = address - self._origin
        listing = list(self._disassembler.disasm(self._code[start : start + size], address))
        return len(listing), self._cycles(listing)


def _cycles(listing: list[Any]) -> int:
    ready: dict[int, int] = {}
    multiplied: set[int] = set()
    cycle = -1
    issued: list[str] = []
    divider = 0
    for instruction in listing:
        kind, latency, slots = _kind(instruction.mnemonic)
        reads, writes = instruction.regs_access()
        early = multiplied & _accumulators(instruction) if kind == "multiply" else set()
        earliest = max((ready.get(reg, 0) - (reg in early) for reg in reads), default=0)
        if kind == "divide":
            earliest = max(earliest, divider)
        if not (issued and earliest <= cycle and _fits(issued, kind)):
            cycle, issued = max(cycle + 1, earliest), []
        issued.append(kind)
        cycle += slots - 1
        if kind == "divide":
            divider = cycle + _DIVIDE_CYCLES
        for reg in writes:
            ready[reg] = cycle + latency
            (multiplied.add if kind == "multiply" else multiplied.discard)(reg)
    branches = bool(listing) and _kind(listing[-1].mnemonic)[0] == "branch"
    return cycle + 1 + branches


def _cycles_one_by_one(listing: list[Any]) -> int:
    cycles, in_memory = 0, False
    for instruction in listing:
        name = instruction.mnemonic.split(".")[0]
        kind, _, _ = _kind(instruction.mnemonic)
        if kind == "load":
            cycles += 1 if in_memory else 2
        elif kind == "double" or name == "strd":
            cycles += 3
        elif kind == "many":
            cycles += len(instruction.operands)
        elif kind == "divide":
            cycles += _DIVIDE_CYCLES
        else:
            cycles += 3 if name.startswith(_FUSED) else 1
        in_memory = kind in ("load", "store")
    branches = bool(listing) and _kind(listing[-1].mnemonic)[0] == "branch"
    return cycles + 2 * branches


def _fits(issued: list[str], kind: str) -> bool:
    if len(issued) == 2 or "many" in (*issued, kind):
        return False
    (first,) = issued
    if {first, kind} <= {"float", "divide"} or {first, kind} <= {"load", "store", "double"}:
        return first == kind == "load"
    return first != kind or kind == "integer"


@cache
def _kind(mnemonic: str) -> tuple[str, int, int]:
    """Return an instruction's class, its latency in cycles, and its cycles in the issue stage."""
    name = mnemonic.split(".")[0]
    if name == "strd":
        return "many", 2, 1
    if name.startswith(("b", "cb")) and name not in ("bic", "bics", "bfi", "bfc"):
        return "branch", 1, 1
    return next((kind for beginnings, kind in _KINDS if name.startswith(beginnings)), ("integer", 1, 1))


def _accumulators(instruction: Any) -> set[int]:
    """Return the registers to which a multiply-accumulate adds. They are needed one cycle later than the factors."""
    operands = [int(operand.reg) for operand in instruction.operands]
    if instruction.mnemonic.startswith(("smlal", "umlal")):
        return set(operands[:2])
    return set(operands[3:])
