"""The whole firmware as Arm's GCC reports it: calls, stack of each function, loops and their bounds.

Two builds are made. The first is the firmware as the exported folder builds it; its stack figures (`-fcallgraph-info`)
are those of the machine code. The second is the whole program at link time, without inlining: GCC knows the range of
every parameter and reports how often each loop runs at most. No source is parsed here.

A call through a pointer may reach every function whose address is taken and whose type is the pointer's. GCC lists
both.
"""

import re
import subprocess
import tempfile
from collections import defaultdict
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from contract.errors import McuError

COMPILER: Final = "arm-none-eabi-gcc"
"""Debian's package is gcc-arm-none-eabi."""
CORE: Final = ("-mcpu=cortex-m7", "-mthumb", "-mfloat-abi=hard", "-mfpu=fpv5-sp-d16")
BARE: Final = (*CORE, "-std=c99", "-O2", "-ffp-contract=off", "-fno-unroll-loops", "-ffreestanding",
               "-ffunction-sections", "-fdata-sections", "-g1")  # fmt: skip
"""As in the exported folder's CMakeLists.txt."""
AS_WRITTEN: Final = ("-flto", "-fno-inline", "-fno-partial-inlining", "-fno-ipa-sra", "-fno-ipa-icf",
                     "-fno-aggressive-loop-optimizations")  # fmt: skip
"""Each function stands once; a bound comes from a loop's exit alone, not from the absence of undefined behaviour."""
DUMPS: Final = ("-fdump-tree-cunrolli-details-lineno", "-fdump-ipa-whole-program")
_LINK: Final = ("-nostartfiles", "-nodefaultlibs", "-Wl,--gc-sections", "-T", "sw_board.ld")
_CALLED_BY_THE_COMPILER: Final = "sw_board_libc.c"
"""It is left out of the whole program: GCC calls memcpy only after it has dropped it."""

_FUNCTION: Final = re.compile(r"^;; Function \S+ \((\S+), .*$", re.MULTILINE)
_LOOP: Final = re.compile(r"^;; Loop (\d+)\n;;  header (\d+), ", re.MULTILINE)
_MOST: Final = re.compile(r"^Loop (\d+) iterates at most (-?\d+) times", re.MULTILINE)
_BLOCK: Final = re.compile(r"^  <bb (\d+)>.*?\n(.*?)(?=^  <bb |^})", re.MULTILINE | re.DOTALL)
_PLACE: Final = re.compile(r"\[(?:\S*/)?([\w.-]+:\d+):\d+\]")
_ASSEMBLY: Final = re.compile(r"\[(?:\S*/)?([\w.-]+:\d+):\d+\] __asm__[^;]*?\bb\w* \d+b\b", re.DOTALL)
_SIGNATURE: Final = re.compile(r"^(\w.*?) ?\b([\w.]+) \((.*)\)\n\{", re.MULTILINE)
_POINTER: Final = re.compile(r"^  (.*?) ?\(\*<\w+>\) \((.*)\) (\w+);", re.MULTILINE)
_GIVEN: Final = re.compile(r"([^,]+?) ?\(\*\w*\) \(([^()]*)\) (\w+)")
_CALL: Final = re.compile(r"\[(?:\S*/)?([\w.-]+:\d+:\d+)\] (?:\S+ = )?(\w+?)(?:\(D\))? \(")
_NODE: Final = re.compile(r'^node: { title: "([^"]+)" label: "([^"]*)"', re.MULTILINE)
_EDGE: Final = re.compile(r'^edge: { sourcename: "([^"]+)" targetname: "([^"]+)"(?: label: "([^"]*)")?', re.MULTILINE)
_TAKEN: Final = re.compile(r"^(\S+)/\d+ \(.*\n  Type: function.*\n(?:  .*\n)*?  Address is taken\.", re.MULTILINE)
_COPY: Final = re.compile(r"\.(?:constprop|lto_priv|isra)(?:\.\d+)?")
"""Endings of copies of a function; the part of a function that GCC makes another one is another one here, too."""
_INDIRECT: Final = "__indirect_call"


@dataclass(frozen=True, kw_only=True)
class Loop:
    """A loop of the program.

    Attributes:
        place: file and line.
        most: largest number of passes that GCC proves; None if it proves none.
    """

    function: str
    place: str
    most: int | None


@dataclass(frozen=True, kw_only=True)
class Calls:
    """Functions with their stack in bytes, and the functions that each calls.

    Attributes:
        unresolved: places of calls through a pointer that reach no known function.
    """

    stack: dict[str, int]
    calls: dict[str, set[str]]
    unresolved: tuple[str, ...]


@dataclass(frozen=True, kw_only=True)
class WholeProgram:
    """The firmware, as it stands in the sources, and as it is built.

    Attributes:
        written, built: calls without and with inlining.
        pointed_at: functions whose address is taken.
        image: linked firmware, an ELF file.
    """

    loops: tuple[Loop, ...]
    written: Calls
    built: Calls
    pointed_at: tuple[str, ...]
    image: bytes


def read_program(files: Mapping[str, bytes]) -> WholeProgram:
    """Compile a firmware (`firmware_sim.mcu.build.board_files`) twice and read what GCC reports. Raises McuError if it
    does not compile, or there is no compiler."""
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place)
        for name, content in files.items():
            (folder / name).write_bytes(content)
        names = sorted(name for name in files if name.endswith(".c") and name != "replay.c")
        for name in names:
            alone = name == _CALLED_BY_THE_COMPILER
            _run(folder, *BARE, *(() if alone else AS_WRITTEN), "-c", name, "-o", f"{name}.lto.o")
            _run(folder, *BARE, "-fcallgraph-info=su", "-c", name, "-o", f"{name}.o")
        objects = [f"{name}.o" for name in names]
        whole = ("-flto-partition=none", "-fwhole-program", "-fcallgraph-info=su", "-save-temps=obj", *DUMPS)
        _run(folder, *BARE, *AS_WRITTEN, *whole, *_LINK, *(f"{name}.lto.o" for name in names), "-lgcc", "-o", "whole.elf")
        _run(folder, *BARE, *_LINK, *objects, "-lgcc", "-o", "board.elf")
        bodies, graph = (_one(folder, f"whole*.{ending}") for ending in ("cunrolli", "ci"))
        _, names = calls_of([graph], {})
        names = {title.rpartition(":")[2]: name for title, name in names.items()}
        pointed_at = {item: names[item] for item in _TAKEN.findall(_one(folder, "whole*.whole-program")) if item in names}
        reached = _reached(bodies, pointed_at)
        return WholeProgram(
            loops=tuple(_loops(bodies, names)),
            written=calls_of([graph], reached)[0],
            built=calls_of((path.read_text(encoding="utf-8") for path in folder.glob("*.c.ci")), reached)[0],
            pointed_at=tuple(sorted(pointed_at.values())),
            image=(folder / "board.elf").read_bytes(),
        )


def calls_of(graphs: Iterable[str], reached: Mapping[str, set[str]]) -> tuple[Calls, dict[str, str]]:
    """Read GCC's call graphs. Returns them, and the names of functions by the titles in the graphs. Raises McuError for
    a function whose stack has no bound.

    Args:
        graphs: contents of `.ci` files.
        reached: functions that a call through a pointer may reach, by place.
    """
    texts = list(graphs)
    names, stack = dict[str, str](), dict[str, int]()
    for title, label in (found for text in texts for found in _NODE.findall(text)):
        function, *rest = label.split("\\n")
        size = re.search(r"(\d+) bytes \((\w+)", label)
        if size is None:
            continue
        if size[2] != "static":
            raise McuError(f"{function}: its stack is {size[2]}, which has no bound")
        names[title] = f"{_COPY.sub('', function)} ({rest[0].split(':')[0].rsplit('/', 1)[-1]})"
        stack[names[title]] = max(stack.get(names[title], 0), int(size[1]))
    calls, unresolved = {name: set[str]() for name in stack}, set[str]()
    for source, target, label in (found for text in texts for found in _EDGE.findall(text)):
        if target != _INDIRECT:
            calls[names[source]].add(names.get(target, target))
            continue
        place = label.rsplit("/", 1)[-1]
        calls[names[source]] |= reached.get(place, set())
        if not reached.get(place):
            unresolved.add(place)
    return Calls(stack=stack, calls=calls, unresolved=tuple(sorted(unresolved))), names


def _loops(bodies: str, names: Mapping[str, str]) -> Iterator[Loop]:
    """Yield each loop in GCC's dump of the functions, and each loop in assembly, which GCC cannot look into."""
    for title, body in _functions(bodies):
        function = names.get(title, title)
        most = {int(number): int(count) for number, count in _MOST.findall(body)}
        blocks = dict(_BLOCK.findall(body))
        for number, header in _LOOP.findall(body):
            if number == "0":
                continue
            places = _PLACE.findall(blocks.get(header, "")) or _PLACE.findall(body)
            bound = most.get(int(number), -1)
            yield Loop(function=function, place=places[-1], most=bound if bound >= 0 else None)
        for place in sorted({item for block in blocks.values() for item in _ASSEMBLY.findall(block)}):
            yield Loop(function=function, place=place, most=None)


def _functions(dump: str) -> Iterator[tuple[str, str]]:
    parts = _FUNCTION.split(dump)
    return zip(parts[1::2], parts[2::2], strict=True)


def _reached(bodies: str, taken: Mapping[str, str]) -> dict[str, set[str]]:
    """Return the functions that a call through a pointer may reach, by place.

    Args:
        bodies: GCC's dump of the functions.
        taken: names of the functions whose address is taken, by their titles in the dump.
    """
    of_type, pointers = defaultdict[str, set[str]](set), list[tuple[str, str]]()
    for title, body in _functions(bodies):
        signature = _SIGNATURE.search(body)
        if signature is None:
            continue
        if title in taken:
            parameters = (re.sub(r"\b\w+$", "", item.strip()) for item in signature[3].split(","))
            of_type[_type(signature[1], parameters)].add(taken[title])
        named = [*_POINTER.findall(body), *_GIVEN.findall(signature[3])]
        known = {name: _type(result, given.split(",")) for result, given, name in named}
        for place, called in _CALL.findall(body):
            kind = known.get(called) or known.get(re.sub(r"_\d+$", "", called))
            if kind:
                pointers.append((place, kind))
    return {place: of_type[kind] for place, kind in pointers}


def _type(result: str, parameters: Iterable[str]) -> str:
    """Return a function's type as a text that does not depend on spaces."""
    plain = (re.sub(r"\brestrict\b|\bstatic\b|\s+", "", item.replace("struct ", "")) for item in (result, *parameters))
    return " ".join(plain)


def _one(folder: Path, pattern: str) -> str:
    (path,) = folder.glob(pattern)
    return path.read_text(encoding="utf-8")


def _run(folder: Path, *arguments: str) -> None:
    try:
        done = subprocess.run([COMPILER, *arguments], cwd=folder, capture_output=True, text=True, check=False)
    except OSError as error:
        raise McuError(f"{COMPILER} does not run: {error.strerror}; Debian's package is gcc-arm-none-eabi") from error
    if done.returncode != 0:
        raise McuError(f"{COMPILER}: {done.stderr.strip()}")
