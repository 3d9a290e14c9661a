"""The loader in C, storage and diagnosis, against its specification in Python, and under hostile requests.

Storage: the supply cut at every operation of the flash memory, altered images, forged records, calls at random.
Diagnosis: testers drive both ECUs, whose frames must be the same at the same times; then hostile requests while
sanitisers watch.
"""

import hashlib
import io
import re
import subprocess
import tempfile
from functools import partial
from pathlib import Path
from typing import Annotated, Any, Final

import capstone
import typer
from elftools.elf.elffile import ELFFile

from benchmarks.controller.bounds import deepest
from benchmarks.controller.whole_program import Calls
from contract.config.tree import Config
from contract.errors import StillwakeError
from ecu.c.sources import loader_sources
from firmware_sim.mcu.build import BARE, compile_with_zig
from tests.can_bridge.flashing.releases import keys
from tests.can_bridge.flashing.store_ecu import SECRET
from tests.proofs.command_line import JsonFile, Processes, Seed, in_parts, report
from tests.proofs.loader_in_c.node_library import GEOMETRY, Library, build, sources
from tests.proofs.loader_in_c.node_program import play, requests_of
from tests.proofs.loader_in_c.node_twin import CONFIGS, OTHERS, World, may_run, world
from tests.proofs.loader_in_c.store_library import rules
from tests.proofs.loader_in_c.store_proof import storage_figures

SANITISED: Final = ("-O1", *GEOMETRY, "-fsanitize=address,undefined", "-fno-sanitize-recover=all", "-g1")
BROKEN: Final = ("stuck", "unlocked_without_key", "activated_unsigned", "releases_lost", "went_back", "wrong_answers")
REACHED: Final = ("trials", "positive", "pending", "tool_unlocked", "tool_packets")
"""Counts that must not be 0, since the program would otherwise show little."""
_WRONG: Final = ("first_findings", "planted_missed", "branches_missed")


def main(
    json_file: JsonFile = None,
    seed: Seed = 0,
    processes: Processes = 2,
    programs: Annotated[int, typer.Option(help="Testers against both ECUs, for each kind of frames.", min=1)] = 2000,
    fuzz_requests: Annotated[int, typer.Option(help="Hostile requests under sanitisers.", min=1)] = 1_000_000,
    images: Annotated[int, typer.Option(help="Images that are altered.", min=1)] = 1_000_000,
    calls: Annotated[int, typer.Option(help="Calls of the store, at random.", min=1)] = 20_000,
    records: Annotated[int, typer.Option(help="Forged records, and as many logs of records.", min=1)] = 10_000,
    seconds: Annotated[int, typer.Option(help="Second cuts in the recovery from each first one.", min=0)] = 2,
    eighths: Annotated[int, typer.Option(help="Of all operations, in which the supply is cut.", min=1, max=8)] = 8,
) -> None:
    """Compare the store in C with the Python store, cut its power, and fuzz it; nothing may differ or be lost."""
    sizes_of: dict[str, Any] = dict(images=images, calls=calls, records=records, seconds=seconds, eighths=eighths)
    storage = storage_figures(seed=seed, processes=processes, **sizes_of)
    differences, compared = list[str](), 0
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        for kind, config in CONFIGS.items():
            build(sources(config), folder / kind, f"{kind}.so")
            for found, calls_made in in_parts(partial(_played, kind, folder, seed), programs, 25, processes, kind):
                differences += found
                compared += calls_made
        of = world("fd", Library(sources(CONFIGS["fd"]), folder / "fd" / "fd.so"))
        corpus(of, folder / "corpus", range(seed, seed + 60))
        program = build(sources(of.config), folder / "fuzz", "node_fuzz", SANITISED)
        fuzzed: dict[str, Any] = {**fuzz(program, folder / "corpus", seed, fuzz_requests)}
        (folder / "sizes").mkdir()
        different = storage["mismatches"] + storage["image_mismatches"] + len(differences)
        figures = storage | {
            "programs": programs * len(CONFIGS), "calls_compared": compared, "mismatches": different,
            "fuzz_requests": fuzzed.pop("requests"), "fuzz": fuzzed, **sizes(folder / "sizes"),
        }  # fmt: skip
    packages = ("stillwake", "cryptography")
    report(json_file, "loader in C", figures, packages=packages, seed=seed, programs=programs, **sizes_of)
    wrong = [*differences, *(one for name in _WRONG for one in storage.get(name, []))]
    if different or wrong or any(fuzzed[name] for name in BROKEN) or not all(fuzzed[name] for name in REACHED):
        raise StillwakeError(f"{different} differ, {fuzzed}: {wrong[:1]}")


def _played(kind: str, folder: Path, seed: int, numbers: range) -> tuple[list[str], int]:
    """What differed, and how many calls were compared."""
    of = world(kind, Library(sources(CONFIGS[kind]), folder / kind / f"{kind}.so"))
    played = [play(of, number, drawn_by=str(seed)) for number in numbers]
    found = [f"{kind} {seed} {number}: {text}" for number, twins in zip(numbers, played, strict=True)
             for text in twins.differences]  # fmt: skip
    return found, sum(twins.compared for twins in played)


def corpus(of: World, file: Path, seeds: range) -> None:
    """What the program reads: a vehicle, its production, and the requests of testers."""
    good = b"".join(hashlib.sha256(image).digest() for image in of.images.values() if may_run(of, image))
    parts = [rules(of.vehicle), SECRET, keys(), of.images["one"], good, *requests_of(of, seeds)]
    file.write_bytes(b"".join(len(part).to_bytes(4, "little") + part for part in parts))


def fuzz(executable: Path, file: Path, seed: int, requests: int) -> dict[str, int]:
    """What the program counted. Raises RuntimeError with a sanitiser's report."""
    command = [str(executable), str(file), str(seed), str(requests)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    if done.returncode != 0:
        raise RuntimeError(f"node_fuzz ended with {done.returncode}: {done.stderr[:2000]}")
    return {name: int(count) for name, count in (line.split() for line in done.stdout.splitlines())}


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
    flash, ram = _memory(_linked(folder, OTHERS["without XCP"]))
    image = _linked(folder, CONFIGS["fd"])
    more_flash, more_ram = _memory(image)
    # What is called of the ECU takes no stack here.
    depth, chain = deepest(_calls(image), "start", 0)
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


def _linked(folder: Path, config: Config) -> Any:
    contents = sources(config)
    own = Path(__file__).with_name("c").joinpath("node_sizes.c").read_bytes()
    compiled = {name for name in loader_sources() if name.endswith(".c")} | {"sw_aes.c", "sw_cmac.c"}
    contents = {name: content for name, content in contents.items() if name.endswith(".h") or name in compiled}
    flags = ("-Os", "-g", *(item for item in BARE if item != "-T"), "-mcpu=cortex_m7", "-Wl,-e,start")
    # By its name the last one to be linked: the order counts for a few bytes.
    compile_with_zig(contents | {"the_sizes.c": own}, folder / "loader.elf", flags)
    return ELFFile(io.BytesIO((folder / "loader.elf").read_bytes()))


def _calls(elf: Any) -> Calls:
    """Bytes of stack that each function takes, and what it calls, read from the instructions."""
    text = elf.get_section_by_name(".text")
    functions = {
        item["st_value"] & ~1: (item.name, item["st_size"])
        for item in _symbols(elf)
        if item["st_info"]["type"] == "STT_FUNC" and item["st_size"]
    }
    machine = capstone.Cs(capstone.CS_ARCH_ARM, capstone.CS_MODE_THUMB + capstone.CS_MODE_MCLASS)
    machine.skipdata = machine.detail = True
    stack, calls = dict[str, int](), dict[str, set[str]]()
    pointed_at, ending = {name for name, _ in functions.values() if _POINTED_AT.fullmatch(name)}, {"end_session"}
    for address, (name, size) in functions.items():
        start = address - text["sh_addr"]
        stack[name], calls[name] = 0, set()
        for line in machine.disasm(text.data()[start : start + size], address):
            kind = line.mnemonic.split(".")[0]
            if kind in ("push", "vpush"):
                stack[name] += len(line.operands) * (8 if kind == "vpush" else 4)
            elif kind in ("sub", "subw") and (found := _STACK.match(line.op_str)):
                stack[name] += int(found[1], 0)
            elif line.op_str.startswith("#") and (target := int(line.op_str[1:], 0) & ~1) in functions:
                calls[name] |= {functions[target][0]} - {name}
            elif kind in ("blx", "bx") and line.op_str != "lr" and name.startswith("sw_uds"):
                calls[name] |= ending if name == "sw_uds_change_session" else pointed_at - ending
    return Calls(stack=stack, calls=calls, unresolved=())
