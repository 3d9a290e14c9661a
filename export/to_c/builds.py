"""The descriptions of a library's folder for CMake, Zephyr, PlatformIO and CMSIS-Pack, from one list of sources."""

import json
from collections.abc import Mapping
from dataclasses import dataclass
from importlib.metadata import version
from typing import Final
from xml.etree import ElementTree as Xml

from contract.controller.c_folder import PROGRAM_SETTINGS, PROGRAM_WEIGHTS, ProgramSettings, library_sources
from contract.release.manifest import WeightPrecision
from export.to_c.library import static_sources

SOURCES: Final = "sources.cmake"
"""Name of the list of sources for CMake, which `CMakeLists.txt` and `zephyr/CMakeLists.txt` include."""
KCONFIG: Final = "zephyr/Kconfig"
PLATFORMIO: Final = "library.json"
PACK: Final = "stillwake.flow_controller.pdsc"
"""Name of the CMSIS-Pack's description file: vendor and name of the pack, as CMSIS prescribes."""
_ABOUT: Final = "Learned controller of jets that cut the drag of a truck's wake: a control step, and the ECU around it"
_HOME: Final = "https://pypi.org/project/stillwake"
_CLASS: Final = "Flow control"
_FLAGS: Final = ("-O2", "-ffp-contract=off")
"""Compiler flags with which C computes the same plans as the exporter, and the Python ECU's decisions, bit for bit."""
_IN_WORDS: Final = {
    "controller": "one control step: a window of pressures in, a plan of the jets out",
    "ecu": "the ECU around the control step: CAN frames in and out",
    "loader": "storage of releases on flash, and diagnosis, around the ECU",
}
"""The parts of a library; each part needs all parts before it."""


@dataclass(frozen=True, kw_only=True)
class LibraryPart:
    """A part of a library that a build may leave out: the control step, the ECU, or the sources in the folder `loader`.
    `folder` is "." for the library's folder itself; `needs` has the names of the parts that this part needs."""

    name: str
    folder: str
    needs: tuple[str, ...]
    sources: tuple[str, ...]
    headers: tuple[str, ...]


def parts(files: Mapping[str, bytes]) -> tuple[LibraryPart, ...]:
    """Return the parts of a library from all files of its folder by their paths. Each part comes after the parts that
    it needs. Raises LibraryError if the library has no settings."""
    precision: WeightPrecision = "int8" if ProgramSettings.of(files).text("SW_PRECISION") == "int8" else "float32"
    step = {*library_sources(static_sources(precision)), PROGRAM_WEIGHTS, PROGRAM_SETTINGS}
    names: dict[str, list[str]] = {name: [] for name in _IN_WORDS}
    for name in sorted(name for name in files if name.endswith((".c", ".h"))):
        if name in step:
            names["controller"].append(name)
        elif name in library_sources(files):
            names["ecu"].append(name)
        elif name.startswith("loader/"):
            names["loader"].append(name)
    return tuple(
        LibraryPart(
            name=name,
            folder="loader" if name == "loader" else ".",
            needs=tuple(_IN_WORDS)[:place],
            sources=tuple(each for each in found if each.endswith(".c")),
            headers=tuple(each for each in found if each.endswith(".h")),
        )
        for place, (name, found) in enumerate(names.items())
        if found
    )


def build_files(files: Mapping[str, bytes]) -> dict[str, bytes]:
    """Return the files that build systems read, except the files that are equal for all libraries (`DOCUMENTS`)."""
    found = parts(files)
    made = {SOURCES: _cmake(found), KCONFIG: _kconfig(found), PLATFORMIO: _platformio(found), PACK: _pack(found)}
    return {name: text.encode() for name, text in made.items()}


def _cmake(found: tuple[LibraryPart, ...]) -> str:
    lines = [
        "# Generated: the parts of the library; each part comes after the parts that it needs.",
        f'set(SW_VERSION "{_version()}")',
        f"set(SW_PARTS {' '.join(part.name for part in found)})",
    ]
    for part in found:
        lines.append(f"set(SW_{part.name.upper()}_FOLDER {part.folder})")
        for what in ("needs", "sources", "headers"):
            values = "".join(f"\n  {value}" for value in getattr(part, what))
            lines.append(f"set(SW_{part.name.upper()}_{what.upper()}{values})")
    return "\n".join(lines) + "\n"


def _kconfig(found: tuple[LibraryPart, ...]) -> str:
    text = f'menuconfig STILLWAKE\n\tbool "stillwake: {_IN_WORDS[found[0].name]}"\n\timply FPU\n\nif STILLWAKE\n'
    for part in found[1:]:
        text += f'\nconfig STILLWAKE_{part.name.upper()}\n\tbool "{_IN_WORDS[part.name]}"\n'
        needed = " && ".join(f"STILLWAKE_{name.upper()}" for name in part.needs[1:])
        text += f"\tdepends on {needed}\n" if needed else "\tdefault y\n"
    text += (
        '\nconfig STILLWAKE_KNOWN_ANSWER\n\tbool "Compare a control step with the exporter\'s result at start-up"\n'
        "\tdefault y\n\thelp\n\t  If the results differ, the jets stay shut. The comparison takes as long as\n"
        "\t  the longest control step.\n\nendif\n"
    )
    return text


def _platformio(found: tuple[LibraryPart, ...]) -> str:
    folders = [f"-I{part.folder}" for part in found if part.folder != "."]
    manifest = {
        "name": "stillwake",
        "version": _version(),
        "description": _ABOUT,
        "keywords": ["flow control", "mpc", "can", "automotive"],
        "homepage": _HOME,
        "license": "MIT",
        "frameworks": "*",
        "platforms": "*",
        "headers": "stillwake.h" if len(found) == 1 else "sw_ecu.h",
        "build": {
            "srcDir": ".",
            "includeDir": ".",
            "srcFilter": ["-<*>", *(f"+<{name}>" for part in found for name in part.sources)],
            "unflags": ["-Os"],
            "flags": [*_FLAGS, *folders],
        },
    }  # fmt: skip
    return json.dumps(manifest, indent=2) + "\n"


def _pack(found: tuple[LibraryPart, ...]) -> str:
    schema = "http://www.w3.org/2001/XMLSchema-instance"
    Xml.register_namespace("xs", schema)
    pack = Xml.Element("package", {"schemaVersion": "1.7.36", f"{{{schema}}}noNamespaceSchemaLocation": "PACK.xsd"})
    vendor, _, named = PACK.removesuffix(".pdsc").partition(".")
    texts = {"vendor": vendor, "name": named, "description": _ABOUT, "url": _HOME, "license": "LICENSE"}
    for name, text in texts.items():
        Xml.SubElement(pack, name).text = text
    release = Xml.SubElement(Xml.SubElement(pack, "releases"), "release", version=_version())
    release.text = f"written by stillwake {_version()}; each release has its own folder"
    conditions, components = Xml.SubElement(pack, "conditions"), Xml.SubElement(pack, "components")
    for part in found:
        component = Xml.SubElement(components, "component", Cclass=_CLASS, Cgroup=part.name, Cversion=_version())
        if part.needs:
            component.set("condition", f"below {part.name}")
            condition = Xml.SubElement(conditions, "condition", id=f"below {part.name}")
            for name in part.needs:
                Xml.SubElement(condition, "require", Cclass=_CLASS, Cgroup=name)
        Xml.SubElement(component, "description").text = _IN_WORDS[part.name]
        inside = Xml.SubElement(component, "files")
        for category, names in (("header", part.headers), ("sourceC", part.sources)):
            for name in names:
                Xml.SubElement(inside, "file", category=category, name=name)
    Xml.indent(pack)
    return '<?xml version="1.0" encoding="UTF-8"?>\n' + Xml.tostring(pack, encoding="unicode") + "\n"


def _version() -> str:
    return version("stillwake")
