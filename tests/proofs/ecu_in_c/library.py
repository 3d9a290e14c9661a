"""The ECU in C as a shared library, its networks replaced by answers that are given, bound through cffi."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

from contract.config.tree import Config
from contract.controller.c_folder import settings_header
from contract.controller.interface import TERMS
from ecu.c import sources as c_sources
from ecu.in_c import compiler
from ecu.in_c.c_settings import HEADER, ecu_settings
from ecu.in_c.c_structs import Leaf, Structs
from export.to_c import library
from tests.proofs.ecu_in_c.variants import bundle_of

EXACT: Final = ("-O1", "-ffp-contract=off")  # nothing is fused: decisions are compared to the bit
SHARED: Final = (*EXACT, "-shared", "-fPIC")
OWN: Final = ("twin.c", "twin.h", "sw_workspace.h", "sw_weights.h", "sw_estimator.h")
"""The library's interface, and stand-ins for headers of the networks."""
FRAMES: Final = 10  # at most in a period, `TWIN_FRAMES`


def ecu_files() -> dict[str, bytes]:
    """Without the networks, which are not compared here: their answers, and the numbers behind them, are given."""
    networks = ("sw_estimator.c", "sw_estimator.h", "sw_inexact.c", "sw_image.c", "sw_image.h")
    step = library.static_sources("float32")
    shared = {name: step[name] for name in ("stillwake.h", "sw_compiler.h", "sw_program.h")}
    return {name: raw for name, raw in (c_sources.control_sources() | shared).items() if name not in networks}


def sources(config: Config) -> dict[str, bytes]:
    bundle = bundle_of(config)
    manifest = bundle.manifest
    sizes = {"SW_WINDOW": manifest.window, "SW_SENSORS": len(manifest.sensors), "SW_HORIZON": manifest.mpc.horizon}
    own = Path(__file__).with_name("c")
    return ecu_files() | {
        **{name: own.joinpath(name).read_bytes() for name in OWN},
        "sw_settings.h": settings_header({**sizes, "SW_TERMS": len(TERMS)}),
        HEADER: ecu_settings(bundle, config),
    }


class Layout:
    """How periods lie in memory in one library: the ECU's structs, the leaves of a response, and a byte for each of its
    bytes, 1 where a leaf lies and 0 in between."""

    def __init__(self, contents: Mapping[str, bytes]) -> None:
        self.structs = Structs(contents, compiler.host_compiler(), header="twin.h")
        self.ffi = self.structs.ffi
        self.leaves = list(self.structs.leaves(self.ffi.typeof("twin_response")))
        compared = bytearray(self.ffi.sizeof("twin_response"))
        for leaf in self.leaves:
            compared[leaf.begin : leaf.end] = b"\1" * (leaf.end - leaf.begin)
        self.compared = bytes(compared)

    def differences(self, expected: Any, found: Any) -> list[str]:
        """The leaves in which two responses differ, each with both values."""
        one, other = (bytes(self.ffi.buffer(self.ffi.addressof(item))) for item in (expected, found))
        return [
            f"{leaf.name}: {self._value(leaf, one)} in Python, {self._value(leaf, other)} in C"
            for leaf in self.leaves
            if one[leaf.begin : leaf.end] != other[leaf.begin : leaf.end]
        ]

    def _value(self, leaf: Leaf, response: bytes) -> Any:
        content = response[leaf.begin : leaf.end]
        return _listed(self.ffi.from_buffer(self.ffi.getctype(leaf.kind, "*"), content)[0])


def _listed(value: Any) -> Any:
    return value if isinstance(value, int | float) else [_listed(item) for item in value]


class Library:
    """One library of the ECU in C, compiled and loaded, and one ECU in it."""

    def __init__(self, contents: Mapping[str, bytes], output: Path) -> None:
        compiler.compile_c(contents, output, compiler=compiler.host_compiler(), flags=SHARED)
        self.layout = Layout(contents)
        ffi = self.layout.ffi
        self.c = ffi.dlopen(str(output))
        self._room, self.found = ffi.new("int64_t[]", self.c.sw_ecu_bytes() // 8 + 1), ffi.new("twin_response *")
        self._ecu = ffi.cast("sw_ecu *", self._room)
        self.c.sw_ecu_init(self._ecu)

    def run(self, periods: Any, count: int) -> int:
        """Live through them: the number of the first that went otherwise than it stands there, or `count`."""
        return int(self.c.twin_run(self._ecu, periods, count, self.layout.compared, self.found))
