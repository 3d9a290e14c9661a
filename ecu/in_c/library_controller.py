"""The controller of a release as its C99 library, which runs on a vehicle's ECU, here compiled for this machine."""

from collections.abc import Sequence
from pathlib import Path

from contract.controller.c_folder import PROGRAM_SETTINGS, ProgramSettings, read_sources
from contract.errors import LibraryError
from contract.release.checks import Bundle, dbc_sha256
from ecu.in_c.compiler import OPTIMISED
from ecu.in_c.host_library import CController


def open_library(
    folder: Path, bundle: Bundle, *, compiler: Sequence[str] | None = None, flags: Sequence[str] = OPTIMISED
) -> CController:
    """Compile a folder that `stillwake export --c` wrote; the result runs instead of the bundle's `controller.onnx`.

    A hash in the library's header states the program from which the folder was generated. The hash protects against
    mix-ups, not against attacks: the sources are unsigned, and are compiled and run as they are. Raises LibraryError if
    the folder holds no library or another program's library, if there is no compiler, or if the compiler rejects the
    sources.

    Args:
        folder: folder of the library.
        bundle: verified release; the library must be generated from the release's program.
        compiler: command that compiles C; None finds a compiler on this machine.
        flags: flags of the compiler.
    """
    sources = read_sources(folder)
    precision = check_program(folder, sources, bundle)
    try:
        controller = CController(sources, bundle.manifest.sizes, compiler=compiler, flags=flags)
    except LibraryError as error:
        raise LibraryError(f"library {folder}: {error}") from error
    controller.description = f"C99 {precision}, {controller.description}"
    return controller


def check_program(folder: Path, sources: dict[str, bytes], bundle: Bundle) -> str:
    """Return the library's precision; raise LibraryError if its header does not belong to the bundle's program."""
    manifest = bundle.manifest
    try:
        header = ProgramSettings.of(sources)
        program, precision = header.text("SW_PROGRAM_SHA256"), header.text("SW_PRECISION")
        # The hash covers the program's sizes, but not those in the header, which the caller's structures use. So an
        # edited header must be rejected.
        sizes = [header.text(name) for name in ("SW_WINDOW", "SW_HORIZON", "SW_SENSOR_NAMES", "SW_SENSORS")]
        dbc = header.text("SW_DBC_SHA256")
    except (LibraryError, UnicodeDecodeError) as error:
        raise LibraryError(f"library {folder}: {error}") from error
    if program != manifest.program_sha256:
        raise LibraryError(
            f"library {folder}: it computes program {program[:12]}, bundle {manifest.name!r} has program "
            f"{manifest.program_sha256[:12]}: a single `stillwake export --c` writes both"
        )
    expected = [manifest.window, manifest.mpc.horizon, " ".join(manifest.sensors), len(manifest.sensors)]
    if sizes != [str(size) for size in expected]:
        raise LibraryError(f"library {folder}: {PROGRAM_SETTINGS} was altered: its sizes are not the program's")
    if dbc != dbc_sha256():
        raise LibraryError(f"library {folder}: built for another stillwake.dbc")
    return precision
