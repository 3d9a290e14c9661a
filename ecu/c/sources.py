"""The hand-written C sources in this folder: the ECU, its loader, its board and its FMUs."""

from collections.abc import Sequence
from importlib.resources import files
from typing import Final

from contract.controller.c_folder import c_files

MONOCYPHER: Final = "4.0.3"
"""Version of Monocypher in `store/vendor`. The files there state `__git__`, which this number replaces."""


def sources_in(folder: str = "") -> dict[str, bytes]:
    """Return the sources, headers and linker scripts in this folder, or in a subfolder of it, by file name."""
    return c_files(files("ecu.c").joinpath(folder))


def control_sources() -> dict[str, bytes]:
    """Return the sources that compute a control period of the ECU, and those that authenticate frames."""
    return sources_in() | sources_in("secoc")


def firmware_sources() -> dict[str, bytes]:
    """Return the sources of the ECU without its control step, and the firmware's, as `board/...` and `loader/...`. The
    generated `sw_ecu_settings.h` is not included (`ecu.in_c.c_settings`)."""
    around = {f"board/{name}": text for name, text in sources_in("board").items()}
    return control_sources() | around | {f"loader/{name}": text for name, text in loader_sources().items()}


def loader_sources() -> dict[str, bytes]:
    """Return the sources of loader, store and diagnosis, which are compiled together with a library's sources.
    The names of Monocypher's sources end in `_c.h`, because another source includes them."""
    return sources_in("store") | sources_in("loader") | {
        name.replace(".c", "_c.h"): text.replace(b"version __git__", f"version {MONOCYPHER}".encode())
        for name, text in sources_in("store/vendor").items()
    }  # fmt: skip


def fmu_sources(*parts: str) -> dict[str, bytes]:
    """Return the sources with which the ECU becomes an FMU. `parts` are folders in `fmu/`: `signals` or `bus`, and
    `fmi2`. The generated `sw_fmu_settings.h` is not included (`firmware_sim.fmu.ecu_variables`)."""
    return sources_in("fmu") | _in_parts(parts)


def plant_fmu_sources(*parts: str) -> dict[str, bytes]:
    """Return the C sources of the plant's FMU, without `sw_plant_settings.h`; `parts` is as in `fmu_sources`."""
    shared = ("sw_fmi3.h", "sw_fmi3_calls.h", "sw_fmu_other.c", "sw_fmu_no_events.c")
    others = {name: text for name, text in fmu_sources("signals").items() if name in shared}
    return sources_in("fmu/plant") | others | _in_parts(parts)


def _in_parts(parts: Sequence[str]) -> dict[str, bytes]:
    return {name: text for part in parts for name, text in sources_in(f"fmu/{part}").items()}


def example_sources() -> dict[str, bytes]:
    """Return the example programs by their paths in a library's folder, without the files of `ecu.in_c.c_examples`."""
    return {f"examples/{name}": content for name, content in sources_in("examples").items()}
