"""What store and diagnosis take of a Cortex-M7: flash, memory, and stack along the deepest chain of calls."""

import io
import re
import subprocess
from collections import defaultdict
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any, Final

import capstone
from elftools.elf.elffile import ELFFile

from ecu.c.sources import loader_sources
from ecu.in_c.compiler import zig_compiler
from firmware_sim.mcu.build import BARE
from tests.proofs.loader_in_c.node_library import sources
from tests.proofs.loader_in_c.node_twin import CONFIGS

_POINTED_AT: Final = re.compile(
    r"control_session|reset|control_communication|hear_tester|read|give_access|write|routine|routine_on|download|"
    r"take_block|write_on|end_transfer|end_session|\w+_faults"
)
"""Functions that the server calls through pointers."""
_IN_FLASH: Final = (".text", ".rodata", ".data", ".ARM.exidx")
_STACK: Final = re.compile(r"sp, (?:sp, )?#(0x[0-9a-f]+|\d+)$")


def sizes(folder: Path) -> dict[str, Any]:
    """`loader_flash_kib` and `loader_ram_kib` without XCP, `xcp_flash_kib` and `xcp_ram_kib` that it takes besides,
    `stack_b` of both with the functions it is of; by -Os."""
    flash, ram = _memory(_linked(folder, xcp=False))
    image = _linked(folder, xcp=True)
    more_flash, more_ram = _memory(image)
    depth, chain = _deepest(image)
    kib = {
        "loader_flash_kib": flash, "loader_ram_kib": ram, "xcp_flash_kib": more_flash - flash,
        "xcp_ram_kib": more_ram - ram,
    }  # fmt: skip
    return {name: round(size / 1024, 2) for name, size in kib.items()} | {"stack_b": depth, "stack_of": chain}


def _symbols(elf: Any) -> list[Any]:
    return [*next(iter(elf.iter_sections("SHT_SYMTAB"))).iter_symbols()]


def _memory(elf: Any) -> tuple[int, int]:
    flash = sum(item["sh_size"] for item in elf.iter_sections() if item.name in _IN_FLASH)
    return flash, next(item["st_size"] for item in _symbols(elf) if item.name == "loader_memory")


def _linked(folder: Path, *, xcp: bool) -> Any:
    bus = CONFIGS["fd"].bus
    config = replace(CONFIGS["fd"], bus=replace(bus, diagnosis=replace(bus.diagnosis, xcp=xcp)))
    contents = sources(config)
    own = Path(__file__).with_name("c").joinpath("node_sizes.c").read_bytes()
    compiled = {name for name in loader_sources() if name.endswith(".c")} | {"sw_aes.c", "sw_cmac.c"}
    contents = {name: content for name, content in contents.items() if name.endswith(".h") or name in compiled}
    for name, content in (contents | {"node_sizes.c": own}).items():
        (folder / name).write_bytes(content)
    flags = [item for item in BARE if item != "-T"]
    command = [
        *(zig_compiler() or []), "-Os", "-g", "-std=c99", *flags, "-mcpu=cortex_m7", "-Wl,-e,start",
        *sorted(compiled), "node_sizes.c", "-o", "loader.elf",
    ]  # fmt: skip
    subprocess.run(command, cwd=folder, check=True, capture_output=True)
    return ELFFile(io.BytesIO((folder / "loader.elf").read_bytes()))


def _deepest(elf: Any) -> tuple[int, list[str]]:
    """Bytes of stack at most below `start`, and the chain of functions; what is called of the ECU takes none here."""
    text = elf.get_section_by_name(".text")
    functions = {
        item["st_value"] & ~1: (item.name, item["st_size"])
        for item in _symbols(elf)
        if item["st_info"]["type"] == "STT_FUNC" and item["st_size"]
    }
    machine = capstone.Cs(capstone.CS_ARCH_ARM, capstone.CS_MODE_THUMB + capstone.CS_MODE_MCLASS)
    machine.skipdata = machine.detail = True
    frames, calls = dict[int, int](), defaultdict[int, set[int]](set)
    pointed_at = {address for address, (name, _) in functions.items() if _POINTED_AT.fullmatch(name)}
    ending = {address for address in pointed_at if functions[address][0] == "end_session"}
    for address, (name, size) in functions.items():
        start = address - text["sh_addr"]
        frames[address] = 0
        for line in machine.disasm(text.data()[start : start + size], address):
            kind = line.mnemonic.split(".")[0]
            if kind in ("push", "vpush"):
                frames[address] += len(line.operands) * (8 if kind == "vpush" else 4)
            elif kind in ("sub", "subw") and (found := _STACK.match(line.op_str)):
                frames[address] += int(found[1], 0)
            elif line.op_str.startswith("#") and (target := int(line.op_str[1:], 0) & ~1) in functions:
                calls[address] |= {target} - {address}
            elif kind in ("blx", "bx") and line.op_str != "lr" and name.startswith("sw_uds"):
                calls[address] |= ending if name == "sw_uds_change_session" else pointed_at - ending

    @cache
    def below(address: int) -> tuple[int, tuple[str, ...]]:
        deepest = max((below(target) for target in calls[address]), default=(0, ()))
        return frames[address] + deepest[0], (functions[address][0], *deepest[1])

    depth, chain = below(next(address for address, (name, _) in functions.items() if name == "start"))
    return depth, list(chain)
