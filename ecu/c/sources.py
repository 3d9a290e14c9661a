"""The hand-written sources in C of the ECU, its loader, its board and its FMUs, from this folder."""

from importlib.resources import files
from typing import Final

from contract.controller.c_folder import c_files

MONOCYPHER: Final = "4.0.3"
"""Version of Monocypher in `store/vendor`, which Monocypher's release writes in place of `__git__`."""


def sources_in(folder: str = "") -> dict[str, bytes]:
    """Sources, headers and linker scripts of a folder, by default of this folder, by name."""
    return c_files(files("ecu.c").joinpath(folder))


def control_sources() -> dict[str, bytes]:
    """The sources of the ECU's control period, with authentication."""
    return sources_in() | sources_in("secoc")


def firmware_sources() -> dict[str, bytes]:
    """The sources of the ECU around a control step, the same for every program and vehicle; `board/` and `loader/` have
    the sources of the firmware around the ECU.

    The generated `sw_ecu_settings.h` (`ecu.in_c.c_settings`) is not included."""
    around = {"board": sources_in("board"), "loader": loader_sources()}
    return control_sources() | {f"{part}/{name}": text for part in around for name, text in around[part].items()}


def loader_sources() -> dict[str, bytes]:
    """The loader, store and diagnosis, the same for every program and vehicle, to be compiled with a library's sources.

    Monocypher's sources are included by one of these and not compiled: their names end in `_c.h`."""
    foreign = sources_in("store/vendor")
    return (
        sources_in("store")
        | sources_in("loader")
        | {
            name.replace(".c", "_c.h"): text.replace(b"version __git__", f"version {MONOCYPHER}".encode())
            for name, text in foreign.items()
        }
    )


def fmu_sources(*parts: str) -> dict[str, bytes]:
    """The FMU around the ECU, with the sources in these folders of `fmu/`: `signals` or `bus`, and `fmi2`. Generated
    for a release: `sw_fmu_settings.h` (`firmware_sim.fmu.ecu_variables`)."""
    found = sources_in("fmu")
    for part in parts:
        found |= sources_in(f"fmu/{part}")
    return found


def plant_fmu_sources(*parts: str) -> dict[str, bytes]:
    """The sources of the wrapper around the plant's FMU, without `sw_plant_settings.h` (`firmware_sim.fmu.plant_fmu`);
    `parts` is as in `fmu_sources`."""
    shared = ("sw_fmi3.h", "sw_fmi3_calls.h", "sw_fmu_other.c", "sw_fmu_no_events.c")
    others = {name: text for name, text in fmu_sources("signals").items() if name in shared}
    return sources_in("fmu/plant") | others | {k: v for part in parts for k, v in sources_in(f"fmu/{part}").items()}


def example_sources() -> dict[str, bytes]:
    """Example programs around the ECU, each with a `main`, by their names in a folder.

    The frames of an example are generated: `examples/pressures.h` (`ecu.in_c.c_examples`)."""
    return {f"examples/{name}": content for name, content in sources_in("examples").items()}
