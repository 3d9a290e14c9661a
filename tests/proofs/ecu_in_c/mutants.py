"""All mutants of the ECU's sources in one library: which of them do the recorded periods notice?

A mutant runs in a process of its own, forked from this one, so that it may crash, and starts from the same memory. It
is found if a period comes out otherwise than it was recorded, if it crashes, does what C does not define (the library
traps it), or runs out of fuel.
"""

import math
import os
import re
import resource
import shutil
import signal
import struct
import subprocess
import tempfile
import tomllib
from collections.abc import Mapping, Sequence
from pathlib import Path
from random import Random
from typing import Any, Final, NamedTuple

from benchmarks.common.command_line import track
from can_bridge.command_gate import GateLimits, gate
from ecu.in_c.compiler import compile_c, host_compiler
from tests.proofs.ecu_in_c.library import Layout, ecu_files, sources
from tests.proofs.ecu_in_c.mutator import all_mutated
from tests.proofs.ecu_in_c.variants import VARIANTS

SECOC: Final = "sw_secoc.c"  # called only in vehicles with a key
MUTATED: Final = (
    "sw_gate.c", "sw_e2e.c", "sw_fail_safe.c", "sw_receiver.c", "sw_timing.c", "sw_speed.c", "sw_past.c", SECOC,
)  # fmt: skip
TRAPPED: Final = (
    "-O1", "-ffp-contract=off", "-shared", "-fPIC", "-w",
    "-fsanitize=undefined,bounds-strict", "-fsanitize-undefined-trap-on-error",
)  # fmt: skip
"""Without a sanitiser's run-time library: what C does not define ends the process."""
FUEL: Final = 100_000  # turns of loops in a period; sound code takes some thousands
CALLS: Final = 4_000  # calls of the gate by itself
SLICE: Final = 100  # periods between two looks at the fuel
SECONDS: Final = 60  # seconds of computing after which a mutant counts as one that does not end


def tried(recordings: Mapping[str, Sequence[bytes]], folder: Path) -> dict[str, Any]:
    """All mutants in all variants, against the recordings of each: how many `mutants`, each counted once, however many
    variants have it; how many `survivors`; those without an explanation, and explanations without a survivor."""
    alive: dict[tuple[str, int, int], str] = {}
    found: set[tuple[str, int, int]] = set()
    for name in track(recordings, "mutants", "variants"):
        mutation = Mutation(name, folder, recordings[name])
        for mutant in [one for one in mutation.mutants if one.place not in found]:
            if mutation.survives(mutant.number):
                alive[mutant.place] = str(mutant)
            else:
                found.add(mutant.place)
    lasting = {place: text for place, text in alive.items() if place not in found}
    left_over = unexplained(sorted(lasting.values()))
    return {"mutants": len(found | lasting.keys()), "survivors": len(lasting), "survivors_unexplained": left_over}


def unexplained(texts: Sequence[str]) -> list[str]:
    """Survivors that no explanation fits, and explanations that fit none."""
    listed = tomllib.loads(Path(__file__).with_name("survivors.toml").read_text(encoding="utf-8"))["survivor"]
    lines = {name: content.decode().splitlines() for name, content in ecu_files().items() if name in MUTATED}
    line_of = {text: lines[text.split(":")[0]][int(text.split(":")[1].split(".")[0]) - 1] for text in texts}
    explained, idle = set[str](), list[str]()
    for file, of_line, mutant in [(one["file"], one.get("line", ""), one["mutant"]) for one in listed]:
        own = [text for text, line in line_of.items() if text.startswith(f"{file}:") and re.search(of_line, line)]
        fits = {text for text in own if re.search(mutant, text)}
        explained |= fits
        if not fits:
            idle.append(f"no survivor fits: {file}: {of_line} {mutant}")
    return [text for text in texts if text not in explained] + idle


def plain(contents: Mapping[str, bytes], file: str) -> str:
    """A source with all that it includes, and with line markers, for a parser of plain C."""
    with tempfile.TemporaryDirectory() as folder:
        for name, content in contents.items():
            Path(folder, name).write_bytes(content)
        # The parser knows no extensions; types are as on any machine with 64 bits.
        for header in Path(__file__).with_name("c").joinpath("plain").glob("*.h"):
            shutil.copy(header, folder)
        command = [*host_compiler(), "-std=c99", "-E", "-nostdinc", "-I.", file]
        return subprocess.run(command, cwd=folder, capture_output=True, text=True, check=True).stdout


class Mutation:
    """The mutants of one variant's library, compiled together, and what has to notice them: calls of the gate by
    itself, and recordings, which are arrays of `twin_period`."""

    def __init__(self, name: str, folder: Path, recordings: Sequence[bytes]) -> None:
        config = VARIANTS[name]
        contents, self._has_key = sources(config), bool(config.bus.key)
        files = [file for file in MUTATED if self._has_key or file != SECOC]
        changed, self.mutants = all_mutated({file: plain(contents, file) for file in files})
        library = folder / f"mutants_{list(VARIANTS).index(name)}.so"
        compile_c({**contents, **changed}, library, compiler=host_compiler(), flags=TRAPPED)
        layout = Layout(contents)
        self._ffi, self._compared = layout.ffi, layout.compared
        self._ffi.cdef(GATE)
        self._ffi.cdef("extern int sw_mutant; extern long sw_fuel_left; void sw_mutate(void);")
        self._c, size = self._ffi.dlopen(str(library)), self._ffi.sizeof("twin_period")
        self._arrays = [(self._ffi.from_buffer("twin_period[]", item), len(item) // size) for item in recordings]
        limits, rng = GateLimits.from_config(config), Random(0)
        self._calls = [gate_case(rng, limits) for _ in range(CALLS)]

    def survives(self, number: int) -> bool:
        """Whether nothing notices this mutant; 0, no mutant, survives always."""
        child = os.fork()
        if child:
            return os.waitpid(child, 0)[1] == 0
        # Here is the mutant. It must not write, nor leave by an exception.
        try:
            resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
            resource.setrlimit(resource.RLIMIT_CPU, (SECONDS, SECONDS))
            for name in (signal.SIGILL, signal.SIGSEGV, signal.SIGFPE, signal.SIGBUS, signal.SIGABRT, signal.SIGXCPU):
                signal.signal(name, signal.SIG_DFL)
            os._exit(0 if self._goes_unnoticed(number) else 1)
        finally:
            os._exit(2)

    def _goes_unnoticed(self, number: int) -> bool:
        ffi, c = self._ffi, self._c
        room, found = ffi.new("int64_t[]", c.sw_ecu_bytes() // 8 + 1), ffi.new("twin_response *")
        ecu = ffi.cast("sw_ecu *", room)
        c.sw_mutant, c.sw_fuel_left = number, FUEL
        c.sw_mutate()
        for case in self._calls:
            gated = c.sw_gate(*case.arguments, ffi.new("sw_gate_limits *", case.limits))
            if (struct.pack("<d", gated.flow_m2_per_s), gated.enable, gated.interventions) != case.answer:
                return False
        if self._has_key and not judges_keys(ffi, c):
            return False
        for array, count in self._arrays:
            for start in range(0, count, SLICE):
                part = min(SLICE, count - start)
                c.sw_fuel_left = FUEL * part
                if c.twin_run(ecu, array + start, part, self._compared, found) != part or c.sw_fuel_left < 0:
                    return False
        return True


def judges_keys(ffi: Any, c: Any) -> bool:
    """Whether a key of zeros is none, by which no frame is authentic, and a key with a single bit is one, by which a
    frame is authentic that it secured, with its freshness."""
    secoc, data = ffi.new("sw_secoc *"), ffi.new("uint8_t[64]")
    fresh = ffi.new("sw_freshness *", (0x01020304, 0x05060708))
    for place in (None, 0, 15):
        key, freshness = bytearray(16 + 1), ffi.new("uint64_t *")
        key[16] = 0xFF  # behind the key
        if place is not None:
            key[place] = 1
        begun = c.sw_secoc_begin(secoc, bytes(key))
        c.sw_secoc_secure(secoc, data, 32, 7, fresh)
        is_authentic = c.sw_secoc_is_authentic(secoc, data, 32, 32, 7, freshness)
        if (begun, is_authentic) != ((1, 0) if place is None else (0, 1)):
            return False
        if place is not None and freshness[0] != 0x0102030405060708:
            return False
    return True


GATE: Final = """
typedef struct { double flow_m2_per_s; uint8_t enable; uint8_t interventions; } sw_gated;
sw_gated sw_gate(double flow_m2_per_s, int enable, double previous_m2_per_s, int has_previous, int64_t previous_ns,
                 int has_pressures, int64_t pressure_ns, int64_t now_ns, const sw_gate_limits *limits);
"""
_WILD: Final = (math.nan, math.inf, -math.inf, 1.7976931348623157e308, -1.7976931348623157e308, 0.0, -0.0)


class GateCase(NamedTuple):
    """Arguments of `sw_gate` in their order, its limits, and its answer: the flow's bits, enable, interventions."""

    arguments: tuple[float, int, float, int, int, int, int, int]
    limits: tuple[float, float]
    answer: tuple[bytes, int, int]


def gate_case(rng: Random, limits: GateLimits) -> GateCase:
    limit, step, period = limits.flow_m2_per_s, limits.step_m2_per_s, limits.period_ns
    edges = (limit, -limit, step, -step, 0.0, 2 * limit, -2 * limit, 0.5 * limit)
    previous = rng.choice((*edges, limit + 3.0 * step, -limit - 3.0 * step, rng.uniform(-limit, limit)))
    wanted = (previous, previous + step, previous - step, math.nextafter(previous, math.inf), 0.5 * previous)
    flow = rng.choice((*edges, *wanted, *_WILD, rng.uniform(-limit, limit)))
    now_ns = rng.choice((10**12, 0, 1, 2**61, rng.randrange(10**13)))
    elapsed = rng.choice((period, period - 1, period + 1, period // 2, 1, 0, -1, rng.randrange(period)))
    age = rng.choice((0, limits.fresh_age_ns, limits.held_age_ns)) + rng.choice((-1, 0, 0, 1))
    previous_ns = rng.choice((0, now_ns - elapsed, now_ns - elapsed))
    pressure_ns = rng.choice((0, now_ns - age, now_ns - age, now_ns + 1))
    enable, has_previous, has_pressures = (int(rng.random() < share) for share in (0.95, 0.8, 0.9))
    arguments = flow, enable, previous, has_previous, previous_ns, has_pressures, pressure_ns, now_ns
    times = dict(previous_ns=previous_ns if has_previous else None, pressure_ns=pressure_ns if has_pressures else None)
    passed = gate(flow, enable=bool(enable), previous_m2_per_s=previous, now_ns=now_ns, limits=limits, **times)
    answer = struct.pack("<d", passed.flow_m2_per_s), int(passed.enable), passed.interventions.value
    return GateCase(arguments, (limits.flow_m2_per_s, limits.step_m2_per_s), answer)
