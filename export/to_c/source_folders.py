"""The hand-written sources in C, by the folders of `sources` that they stand in."""

from importlib.resources import files
from typing import Final

MONOCYPHER: Final = "4.0.3"
"""Version of the code of others in `loader/vendor`; its own release writes it in place of `__git__`."""


def sources_in(*folders: str) -> dict[str, bytes]:
    """Their sources, headers and linker scripts by name."""
    root = files("export.to_c").joinpath("sources")
    return {
        item.name: item.read_bytes()
        for folder in folders
        for item in root.joinpath(folder).iterdir()
        if item.name.endswith((".c", ".h", ".ld"))
    }


def loader_sources() -> dict[str, bytes]:
    """The loader with diagnosis, the same for every program and vehicle, to be compiled with a library's sources.

    Monocypher's sources are included by one of these and not compiled: their names end in `_c.h`.
    """
    foreign = sources_in("loader/vendor")
    return sources_in("loader") | {
        name.replace(".c", "_c.h"): text.replace(b"version __git__", f"version {MONOCYPHER}".encode())
        for name, text in foreign.items()
    }


def fmu_sources() -> dict[str, bytes]:
    """The FMU around the ECU. Generated for a release: `sw_fmu_settings.h` (`firmware_sim.fmu.ecu_variables`)."""
    return sources_in("fmu")


def plant_fmu_sources() -> dict[str, bytes]:
    """What stands in front of the plant's FMU, but for `sw_plant_settings.h` (`firmware_sim.fmu.plant_fmu`)."""
    shared = ("sw_fmi3.h", "sw_fmi3_calls.h", "sw_fmu_other.c")
    return sources_in("fmu/plant") | {name: text for name, text in fmu_sources().items() if name in shared}
