"""The whole firmware as Arm's GCC reports it: calls, stack of each function, loops and their bounds.

Two builds are made. The first is the firmware as the exported folder builds it; GCC reports the stack that its machine
code needs (`-fcallgraph-info`). The second is the whole program at link time, without inlining: GCC knows the range of
every parameter and reports the largest number of passes of each loop.

A call through a pointer may reach every function whose address is taken and whose type fits the pointer. GCC lists the
functions whose address is taken, and their types.
"""

import re
import subprocess
import tempfile
from collections import defaultdict
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Final, NamedTuple

from contract.controller.c_folder import REPLAY
from contract.errors import McuError

COMPILER: Final = "arm-none-eabi-gcc"
BARE: Final = (
    *("-mcpu=cortex-m7", "-mthumb", "-mfloat-abi=hard", "-mfpu=fpv5-sp-d16", "-std=c99", "-O2", "-ffp-contract=off"),
    *("-fno-unroll-loops", "-ffreestanding", "-ffunction-sections", "-fdata-sections", "-g1"),
)
"""The flags of the compiler in the exported folder's CMakeLists.txt."""
AS_WRITTEN: Final = ("-flto", "-fno-inline", "-fno-partial-inlining", "-fno-ipa-sra", "-fno-ipa-icf",
                     "-fno-aggressive-loop-optimizations")  # fmt: skip
"""Flags that keep one copy of each function. With them GCC also computes a loop's bound only from the loop's exit, and
not from the assumption that there is no undefined behaviour."""
DUMPS: Final = ("-fdump-tree-cunrolli-details-lineno", "-fdump-ipa-whole-program")
_LINK: Final = ("-nostartfiles", "-nodefaultlibs", "-Wl,--gc-sections", "-T", "sw_board.ld")
_CALLED_BY_THE_COMPILER: Final = "sw_board_libc.c"
"""File that is compiled without link-time optimisation: GCC would remove the file's memcpy before it generates calls of
memcpy."""

_FUNCTION: Final = re.compile(r"^;; Function \S+ \((\S+), .*$", re.MULTILINE)
_LOOP: Final = re.compile(r"^;; Loop (\d+)\n(?:;;  [hd].*\n)*;;  nodes: ([\d ]+)", re.MULTILINE)
_MOST: Final = re.compile(r"^Loop (\d+) iterates at most (-?\d+) times", re.MULTILINE)
_BLOCK: Final = re.compile(r"^  <bb (\d+)>.*?\n(.*?)(?=^  <bb |^})", re.MULTILINE | re.DOTALL)
_PLACE: Final = re.compile(r"\[(?:\S*/)?([\w.-]+):(\d+):\d+\]")
_ASSEMBLY: Final = re.compile(r"\[(?:\S*/)?([\w.-]+:\d+):\d+\] __asm__[^;]*?\bb\w* \d+b\b", re.DOTALL)
_SIGNATURE: Final = re.compile(r"^(\w.*?) ?\b([\w.]+) \((.*)\)\n\{", re.MULTILINE)
_POINTER: Final = re.compile(r"^  (.*?) ?\(\*<\w+>\) \((.*)\) (\w+);", re.MULTILINE)
_GIVEN: Final = re.compile(r"([^,]+?) ?\(\*\w*\) \(([^()]*)\) (\w+)")
_CALL: Final = re.compile(r"\[(?:\S*/)?([\w.-]+:\d+:\d+)\] (?:\S+ = )?(\w+?)(?:\(D\))? \(")
_NODE: Final = re.compile(r'^node: { title: "([^"]+)" label: "([^"]*)"', re.MULTILINE)
_EDGE: Final = re.compile(r'^edge: { sourcename: "([^"]+)" targetname: "([^"]+)"(?: label: "([^"]*)")?', re.MULTILINE)
_TAKEN: Final = re.compile(r"^(\S+)/\d+ \(.*\n  Type: function.*\n(?:  .*\n)*?  Address is taken\.", re.MULTILINE)
_COPY: Final = re.compile(r"\.(?:constprop|lto_priv|isra)(?:\.\d+)?")
"""Pattern of the suffixes that GCC gives to copies of a function, but not to parts that it splits off a function."""
_INDIRECT: Final = "__indirect_call"


class Loop(NamedTuple):
    """A loop of the program, its place, and the largest number of passes that GCC proves; None if it proves none."""

    function: str
    place: str
    most: int | None


class Calls(NamedTuple):
    """Each function's stack in bytes, the functions that it calls, and calls through pointers without known targets."""

    stack: dict[str, int]
    calls: dict[str, set[str]]
    unresolved: tuple[str, ...]


class Built(NamedTuple):
    """The firmware as the exported folder builds it: its calls after inlining, and the linked image, an ELF file."""

    calls: Calls
    image: bytes


class WholeProgram(NamedTuple):
    """The firmware as written (without inlining), and as built; `pointed_at`: functions whose address is taken."""

    loops: tuple[Loop, ...]
    written: Calls
    built: Built
    pointed_at: tuple[str, ...]


def read_program(files: Mapping[str, bytes]) -> WholeProgram:
    """Compile a firmware (`firmware_sim.mcu.build.board_files`) twice and read GCC's reports. Raises McuError if the
    firmware does not compile, or there is no compiler."""
    with _written(files) as (folder, names):
        for name in names:
            alone = name == _CALLED_BY_THE_COMPILER
            _run(folder, *BARE, *(() if alone else AS_WRITTEN), "-c", name, "-o", f"{name}.o")
        whole = ("-flto-partition=none", "-fwhole-program", "-fcallgraph-info=su", "-save-temps=obj", *DUMPS)
        _run(folder, *BARE, *AS_WRITTEN, *whole, *_LINK, *(f"{name}.o" for name in names), "-lgcc", "-o", "whole.elf")
        reports = [path for end in ("cunrolli", "ci", "whole-program") for path in folder.glob(f"whole*.{end}")]
        bodies, graph, symbols = (path.read_text(encoding="utf-8") for path in reports)
    _, titles = calls_of([graph], {})
    names_of = {title.rpartition(":")[2]: name for title, name in titles.items()}
    pointed_at = {item: names_of[item] for item in _TAKEN.findall(symbols) if item in names_of}
    reached = _reached(bodies, pointed_at)
    return WholeProgram(
        loops=tuple(_loops(bodies, names_of)),
        written=calls_of([graph], reached)[0],
        built=read_built(files, reached),
        pointed_at=tuple(sorted(pointed_at.values())),
    )


def read_built(files: Mapping[str, bytes], reached: Mapping[str, set[str]] | None = None) -> Built:
    """Compile a firmware as the exported folder does. `calls_of` explains `reached`, which is None if no function
    is called through a pointer. Raises McuError as `read_program` does."""
    with _written(files) as (folder, names):
        for name in names:
            _run(folder, *BARE, "-fcallgraph-info=su", "-c", name, "-o", f"{name}.o")
        _run(folder, *BARE, *_LINK, *(f"{name}.o" for name in names), "-lgcc", "-o", "board.elf")
        graphs = [path.read_text(encoding="utf-8") for path in folder.glob("*.c.ci")]
        return Built(calls=calls_of(graphs, reached or {})[0], image=(folder / "board.elf").read_bytes())


@contextmanager
def _written(files: Mapping[str, bytes]) -> Iterator[tuple[Path, list[str]]]:
    """Yield a temporary folder with the files, and the names of the sources to compile."""
    with tempfile.TemporaryDirectory() as place:
        for name, content in files.items():
            Path(place, name).write_bytes(content)
        yield Path(place), sorted(name for name in files if name.endswith(".c") and name != REPLAY)


def calls_of(graphs: Iterable[str], reached: Mapping[str, set[str]]) -> tuple[Calls, dict[str, str]]:
    """Read GCC's call graphs, the contents of `.ci` files. Returns the calls, and the names of functions by their
    titles in the graphs. Raises McuError for a function whose stack has no bound. `reached` are the functions that a
    call through a pointer may reach, by the place of the call."""
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
    """Yield each loop in GCC's dump of the functions; for loops in assembly GCC computes no bound."""
    for title, body in _functions(bodies):
        function = names.get(title, title)
        most = {int(number): int(count) for number, count in _MOST.findall(body)}
        # A line that begins with # states where the value of a variable was computed, possibly before the loop. Such
        # lines are removed, because they would give a wrong place of the loop.
        blocks = {number: re.sub(r"^ *# .*$", "", block, flags=re.MULTILINE) for number, block in _BLOCK.findall(body)}
        for number, nodes in _LOOP.findall(body):
            if number == "0":
                continue
            inside = (found for node in nodes.split() for found in _PLACE.findall(blocks.get(node, "")))
            places = list(inside) or _PLACE.findall(body)
            first = min(places, key=lambda place: int(place[1]))
            bound = most.get(int(number), -1)
            yield Loop(function=function, place=":".join(first), most=bound if bound >= 0 else None)
        for place in sorted({item for block in blocks.values() for item in _ASSEMBLY.findall(block)}):
            yield Loop(function=function, place=place, most=None)


def _functions(dump: str) -> Iterator[tuple[str, str]]:
    parts = _FUNCTION.split(dump)
    return zip(parts[1::2], parts[2::2], strict=True)


def _reached(bodies: str, taken: Mapping[str, str]) -> dict[str, set[str]]:
    """Return the functions that each call through a pointer may reach, by the call's place. `bodies` is GCC's dump of
    the functions; `taken` has the names of the functions whose address is taken, by their titles in the dump."""
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
    """Return a function's type as a text that does not depend on the spaces in the dump."""
    plain = (re.sub(r"\brestrict\b|\bstatic\b|\s+", "", item.replace("struct ", "")) for item in (result, *parameters))
    return " ".join(plain)


def gcc_version() -> str:
    """Return the compiler's name and version; raises McuError if there is no compiler."""
    return _run(Path.cwd(), "--version").splitlines()[0]


def _run(folder: Path, *arguments: str) -> str:
    try:
        done = subprocess.run([COMPILER, *arguments], cwd=folder, capture_output=True, text=True, check=False)
    except OSError as error:
        raise McuError(f"{COMPILER} does not run: {error.strerror}; Debian's package is gcc-arm-none-eabi") from error
    if done.returncode != 0:
        raise McuError(f"{COMPILER}: {done.stderr.strip()}")
    return done.stdout
