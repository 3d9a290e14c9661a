"""The ECU in C, compiled for this machine, with the interface of the ECU in Python.

The sources come from a folder that `stillwake export --c` writes (`contract.controller.c_folder`). cffi connects them
to Python in its ABI mode: it reads functions and structs from the library's header, without compiled glue code.
"""

import re
import tempfile
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, ClassVar, Final, Unpack

from can_bridge.bus.interface import HEALTHY, BusHealth
from can_bridge.wire.frame import Frame
from can_bridge.wire.messages import EcuStatus
from contract.config.tree import Config
from contract.controller.c_folder import library_sources, read_sources
from contract.controller.calibration import CALIBRATION_NAMES, Calibration
from contract.controller.image_payload import with_layout
from contract.errors import ConfigError, LibraryError
from contract.release.checks import Bundle
from contract.runtime.copies import NeverCopied
from ecu.ecu_state import EcuState, Surroundings, Trace
from ecu.in_c import c_settings
from ecu.in_c.c_structs import Structs, c_time
from ecu.in_c.compiler import EXACT, compile_c, compiler_version, host_compiler
from ecu.in_c.host_library import check_program

_BUNDLE_HASH: Final = re.compile(rb"^#define SW_BUNDLE_HASH UINT32_C\((0x[0-9a-f]+)\)$", re.MULTILINE)
_UNDEFINED: Final = re.compile(r"undefined symbol: (\w+)")
_ALIGNMENT: Final = 64
_Answer = Callable[[Any], int]
_ESTIMATOR: Final = ("sw_estimator_settings.h", "sw_estimator_weights.c")
"""Names of the files that are generated for a release with a sensor estimator."""


class CEcuState(NeverCopied):
    """A view of the state, the trace and the calibration of an ECU in C, on any machine that runs the ECU.

    Args:
        ecu: pointer to the ECU's `sw_ecu`, or to a copy of it in this machine's memory.
        calibrate: calls `sw_ecu_calibrate` with an `sw_calibration` and returns its result.
        restore: calls `sw_ecu_restore`, or an equivalent, with a pointer to an `sw_ecu_state` and returns its result.
    """

    INSTEAD: ClassVar = "its state is in C's memory; pass it to `restore` of another ECU of the same sources"

    def __init__(self, structs: Structs, ecu: Any, bundle_hash: int, calibrate: _Answer, restore: _Answer) -> None:
        self.structs = structs
        self._ecu, self._bundle_hash, self._calibrate, self._restore = ecu, bundle_hash, calibrate, restore

    @property
    def state(self) -> EcuState:
        return self.structs.state(self._ecu.state)

    @property
    def trace(self) -> Trace:
        return self.structs.trace(self._ecu)

    def status(self) -> EcuStatus:
        return self.state.status(self._bundle_hash)

    @property
    def calibration(self) -> Calibration:
        return Calibration.unpack(bytes(self.structs.ffi.buffer(self.structs.ffi.addressof(self._ecu.calibration))))

    def calibrate(self, calibration: Calibration) -> None:
        """Calibrate like `Ecu.calibrate`; the C code checks the values."""
        if (number := self._calibrate(calibration.pack())) != 0:
            name, value = CALIBRATION_NAMES[number - 1], calibration.values[number - 1]
            raise ConfigError(f"calibration: {name} = {value:g}: must be within the limits of this release and vehicle")

    def differing(self, state: EcuState) -> list[str]:
        """Return the names of the numbers that differ between this ECU's state and `state`, bit for bit."""
        return self.structs.differing(self._ecu.state, state)

    def saved(self) -> bytes:
        """Return the bytes of the state in C's memory."""
        return bytes(self.structs.ffi.buffer(self.structs.ffi.addressof(self._ecu.state)))

    def restore(self, state: EcuState | bytes) -> None:
        """Continue from the bytes of `saved`, or from the state of any ECU with the same release, settings and
        calibration. Raises ValueError if the C code rejects the state: it has another delay, or no ECU can reach it."""
        ffi, place = self.structs.ffi, self.structs.ffi.new("sw_ecu_state *")
        if isinstance(state, bytes):
            ffi.buffer(place)[:] = state
        else:
            self.structs.set_state(place, state)
        if self._restore(place) != 0:
            raise ValueError("the state has another delay of the actuator, or a number is out of range")


class CEcu(CEcuState):
    """A C library's ECU, compiled for this machine, with the interface of `ecu.ecu.Ecu`. Raises LibraryError if there
    is no compiler, if the compiler rejects the files, or if the files contain no ECU.

    Args:
        sources: the library's files by name, including `sw_ecu_settings.h`. A caller may replace or add files.
        compiler: command that compiles C; None finds a compiler on this machine.
        secret: the bytes of the key if `bus.key` is set; the ECU is then in its first power cycle.

    Attributes:
        description: compiler and flags of the control step, in words.
        lib, ecu: the loaded library and its `sw_ecu`; `Structs.ffi` declares the types of both.
    """

    def __init__(
        self,
        sources: Mapping[str, bytes],
        *,
        compiler: Sequence[str] | None = None,
        flags: Sequence[str] = EXACT,
        secret: bytes | None = None,
    ) -> None:
        command = host_compiler() if compiler is None else list(compiler)
        structs, bundle_hash = Structs(sources, command), bundle_hash_of(sources)
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder, "ecu.so")
            compile_c(library_sources(sources), path, compiler=command, flags=("-fPIC", "-shared", *flags))
            try:
                self.lib: Any = structs.ffi.dlopen(str(path))
                sizes = self.lib.sw_ecu_state_bytes(), self.lib.sw_ecu_bytes()
                self._run = self.lib.sw_ecu_step
            except (OSError, AttributeError) as error:
                raise LibraryError(f"the compiled library does not load: {_why(error)}; export it again") from error
        expected = structs.size("sw_ecu_state")
        if sizes[0] != expected:
            raise LibraryError(f"sw_ecu_state has {sizes[0]} bytes in the library, but {expected} in the header")
        self.description = f"{compiler_version(command)}, {' '.join(flags)}"
        ffi = structs.ffi
        self._room = ffi.new("char[]", sizes[1] + _ALIGNMENT)
        start = -int(ffi.cast("uintptr_t", self._room)) % _ALIGNMENT
        self.ecu = ecu = ffi.cast("sw_ecu *", self._room + start)
        # In older versions of the library this function returns nothing, which counts as success.
        if self.lib.sw_ecu_init(ecu):
            raise LibraryError(
                f"the compiled ECU does not run: {' '.join(flags)} or this process's floating-point mode changes the "
                f"ECU's arithmetic, or the release's numbers are damaged; GCC needs -ffp-contract=off"
            )
        if secret is not None:
            if not hasattr(self.lib, "sw_ecu_authenticate"):
                raise LibraryError("the library's settings are for a bus without a key (bus.key)")
            if self.lib.sw_ecu_authenticate(ecu, ffi.new("sw_authentication *", {"key": secret, "trip": 1})):
                raise ConfigError("bus.key: is a key of zeros; must be a random key")
        lib, buffer = self.lib, ffi.from_buffer
        super().__init__(structs, ecu, bundle_hash,
            lambda packed: int(lib.sw_ecu_calibrate(ecu, buffer("sw_calibration *", packed))),
            lambda state: int(lib.sw_ecu_restore(ecu, state)),
        )  # fmt: skip
        self._answers = ffi.new("sw_frame[2]")
        self.restore(self.saved())

    def step(
        self, now_ns: int, frames: Sequence[Frame], health: BusHealth = HEALTHY, **around: Unpack[Surroundings]
    ) -> list[Frame]:
        self.structs.surround(self._ecu.surroundings, health, **around)
        count = self._run(self._ecu, c_time(now_ns), self.structs.frames(frames), len(frames), self._answers)
        return [self.structs.frame(self._answers[i]) for i in range(count)]


def _why(error: Exception) -> str:
    """Return the cause in one line; cffi's own message also has the file twice and all searched paths."""
    symbol = _UNDEFINED.search(str(error))
    return str(error).splitlines()[0] if symbol is None else f"its sources lack {symbol.group(1)}"


def bundle_hash_of(sources: Mapping[str, bytes]) -> int:
    """Return the short hash of the bundle in an ECU's settings; raise LibraryError if the settings have no hash."""
    found = _BUNDLE_HASH.search(sources.get(c_settings.HEADER, b""))
    if found is None:
        raise LibraryError(f"{c_settings.HEADER}: SW_BUNDLE_HASH is missing, so this is no header of an ECU's settings")
    return int(found.group(1), 16)


def ecu_sources(folder: Path, bundle: Bundle, config: Config) -> dict[str, bytes]:
    """Return a library's sources for a release, with the settings of this vehicle. Raises LibraryError if the folder
    holds no library with an ECU, or another controller's; StillwakeError for a setting that C does not support."""
    sources = read_sources(folder, board=True)
    check_program(folder, sources, bundle)
    if c_settings.HEADER not in sources:
        raise LibraryError(f"library {folder}: it has only the control step and no ECU; export it again")
    check = config.ecu.sensor_check
    if bundle.manifest.sensor_estimator is None and check.enabled:
        # As in the ECU in Python, a release without an estimator has no sensor check.
        config = replace(config, ecu=replace(config.ecu, sensor_check=replace(check, enabled=False)))
    elif check.enabled and _ESTIMATOR[0] not in sources:
        raise LibraryError(f"library {folder}: it has no sensor estimator; export it again, or switch off sensor_check")
    if not config.ecu.sensor_check.enabled:
        # Without the check, `sw_ecu.h` does not declare the estimator, so the estimator's numbers would not compile.
        sources = {name: content for name, content in sources.items() if name not in _ESTIMATOR}
    return with_layout(sources | {c_settings.HEADER: c_settings.ecu_settings(bundle, config)})
