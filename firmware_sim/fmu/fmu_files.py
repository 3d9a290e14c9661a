"""The files of both FMUs, for any tool that imports FMI 3.0 or 2.0. The FMU of the ECU has the compiled C library and
its sources. The FMU of the plant has settings, a script that `pythonfmu3` runs, and a binary that checks the calls."""

import hashlib
import json
import platform
import shutil
import sys
import tempfile
import uuid
import zipfile
from collections.abc import Mapping
from io import BytesIO
from pathlib import Path
from typing import Final
from xml.etree import ElementTree

from contract.config.loading import to_tree
from contract.config.tree import Config
from contract.controller.c_folder import library_sources
from contract.errors import ConfigError, LibraryError
from contract.release.checks import Bundle
from ecu.c.sources import fmu_sources, plant_fmu_sources
from ecu.in_c.compiler import compile_c, host_compiler, zig_compiler
from firmware_sim.fmu.descriptions import as_fmi2, bus_files, model_description, xml_bytes
from firmware_sim.fmu.ecu_variables import IDENTIFIER, ecu_variables, wrapper_settings
from firmware_sim.fmu.kinds import WITH_SIGNALS, FmuKind

PLATFORM: Final = f"{platform.machine()}-{sys.platform}"
"""Name of this machine's platform in FMI 3.0, such as x86_64-linux."""
WINDOWS_64: Final = "x86_64-windows"
PLATFORMS_2: Final = {"x86_64-linux": "linux64", "x86_64-darwin": "darwin64", WINDOWS_64: "win64"}
"""FMI 2.0's names of platforms by their names in FMI 3.0, for the platforms whose names differ."""
FLAGS: Final = ("-O3", "-ffp-contract=off", "-fPIC", "-shared", "-fvisibility=hidden", "-Wl,--no-undefined")
"""Flags of the compiler. There is no -march, because an FMU may run on another machine."""
_FLAGS_WINDOWS: Final = ("-target", f"{WINDOWS_64}-gnu", "-O3", "-ffp-contract=off", "-shared", "-s")
_SETTINGS: Final = "sw_fmu_settings.h"
_PLANT_SETTINGS: Final = "sw_plant_settings.h"
BEHIND: Final = "pythonfmu.so"
"""File name of `pythonfmu3`'s binary in the FMU. The binary that checks the calls loads this file."""
_DESCRIPTION: Final = "modelDescription.xml"


def ecu_fmu(ecu: Mapping[str, bytes], bundle: Bundle, config: Config, kind: FmuKind = WITH_SIGNALS) -> bytes:
    """Return the ECU's FMU as a file; equal arguments and an equal compiler give equal bytes. `ecu` is the result of
    `ecu.in_c.c_ecu.ecu_sources` for this verified release and vehicle. Raises LibraryError if there is no compiler, or
    the compiler rejects the sources; with a bus, ConfigError if step offset or compute time is too long."""
    sources = library_sources(ecu) | fmu_sources(*kind.sources)
    variables = ecu_variables(bundle.manifest.sensors, config, bus=kind.bus)
    for name in ("step_offset_ms", "compute_time_ms") if kind.bus else ():
        value, period_ms = getattr(config.ecu, name), config.period_ns / 1e6
        if value >= period_ms:
            raise ConfigError(f"ecu.{name} = {value:g}: must be shorter than the control period of {period_ms:g} ms")
    made_from = hashlib.sha256(repr(sorted(sources.items())).encode()).digest()
    token = f"{{{uuid.UUID(bytes=made_from[:16])}}}"
    sources[_SETTINGS] = wrapper_settings(variables, token, config, kind)
    described = model_description(variables, token, bundle, config, kind)
    contents = {f"sources/{name}": content for name, content in sorted(sources.items())}
    if kind.fmi2:
        described = as_fmi2(described, [name for name in sorted(sources) if name.endswith(".c")])
    else:
        contents = {"sources/buildDescription.xml": _build_description(sources), **contents}
    contents = {"modelDescription.xml": xml_bytes(described), **binaries(sources, kind), **contents}
    return zipped(contents | (bus_files() if kind.bus else {}))


def binaries(sources: Mapping[str, bytes], kind: FmuKind) -> dict[str, bytes]:
    """Return the compiled libraries by their paths in the FMU: for this machine and, if `kind.windows`, for Windows."""
    made = {PLATFORM: (host_compiler(), FLAGS, "so")}
    if kind.windows:
        zig = zig_compiler()
        if zig is None:
            raise LibraryError("an FMU for Windows needs ziglang: pip install '.[mcu]'")
        made[WINDOWS_64] = zig, _FLAGS_WINDOWS, "dll"
    found = {}
    for name, (compiler, flags, ending) in made.items():
        with tempfile.TemporaryDirectory() as folder:
            binary = Path(folder, f"{IDENTIFIER}.{ending}")
            compile_c(sources, binary, compiler=compiler, flags=flags)
            found[f"binaries/{platform_of(name, kind)}/{binary.name}"] = binary.read_bytes()
    return found


def platform_of(name: str, kind: FmuKind) -> str:
    """Return the name of the folder in `binaries/` for a platform, given by its name in FMI 3.0."""
    return PLATFORMS_2.get(name, name) if kind.fmi2 else name


def zipped(contents: Mapping[str, bytes]) -> bytes:
    """Return a zip file with these contents; its bytes depend only on the contents."""
    file = BytesIO()
    with zipfile.ZipFile(file, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, content in contents.items():
            info = zipfile.ZipInfo(name)  # dated 1980
            info.external_attr = 0o644 << 16
            archive.writestr(info, content, zipfile.ZIP_DEFLATED)
    return file.getvalue()


def _build_description(sources: Mapping[str, bytes]) -> bytes:
    add = ElementTree.SubElement
    root = ElementTree.Element("fmiBuildDescription", fmiVersion="3.0")
    configuration = add(root, "BuildConfiguration", modelIdentifier=IDENTIFIER)
    files = add(configuration, "SourceFileSet", language="C99", compilerOptions="-ffp-contract=off")
    for name in sorted(sources):
        if name.endswith(".c"):
            add(files, "SourceFile", name=name)
    return xml_bytes(root)


def plant_fmu(config: Config, start: Path | None = None, kind: FmuKind = WITH_SIGNALS) -> bytes:
    """Return the plant's FMU as a file. `start` is the file of the initial flow state; if None, the shipped state.
    Raises PlantError if the state is of another plant, or the plant is not stable; LibraryError without a compiler, or
    a binary of `pythonfmu3` for this machine; ModuleNotFoundError without `pythonfmu3` (extra fmu)."""
    from pythonfmu3.builder import FmuBuilder

    from firmware_sim.fmu import plant_slave

    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        files = [folder / plant_slave.SETTINGS]
        files[0].write_text(json.dumps(to_tree(config)), encoding="utf-8")
        if start is not None:
            files.append(folder / plant_slave.START)
            shutil.copyfile(start, files[-1])
        made = FmuBuilder.build_FMU(Path(plant_slave.__file__), folder, files, canGetAndSetFMUState=True)
        with zipfile.ZipFile(made) as archive:
            contents = {item: archive.read(item) for item in archive.namelist() if not item.endswith("/")}
        about = ElementTree.fromstring(contents[_DESCRIPTION])
        simulated = about.find("CoSimulation")
        assert simulated is not None
        simulated.set("fixedInternalStepSize", repr(config.period_ns / 1e9))
        binary = f"binaries/{PLATFORM}/{simulated.get('modelIdentifier')}.so"
        if binary not in contents:
            raise LibraryError(f"no FMU of the plant for {PLATFORM}: pythonfmu3 has no binary for this platform")
        of_pythonfmu = contents.pop(binary)
        compiled = folder / "front.so"
        front = plant_fmu_sources(*kind.sources[1:]) | {_PLANT_SETTINGS: _plant_settings(about)}
        compile_c(front, compiled, compiler=host_compiler(), flags=(*FLAGS, "-ldl"))
        place, described = f"binaries/{platform_of(PLATFORM, kind)}", as_fmi2(about) if kind.fmi2 else about
        own = {f"{place}/{Path(binary).name}": compiled.read_bytes(), f"{place}/{BEHIND}": of_pythonfmu}
        return zipped(contents | {_DESCRIPTION: xml_bytes(described)} | own)


def _plant_settings(about: ElementTree.Element) -> bytes:
    """Return `sw_plant_settings.h`; the value references of the inputs must be consecutive."""
    variables = about.findall("ModelVariables/*")
    inputs = [int(item.get("valueReference", "")) for item in variables if item.get("causality") == "input"]
    assert inputs == list(range(inputs[0], inputs[-1] + 1))
    return (
        "/* Generated: the variables of the plant's FMU. */\n"
        f'#define SW_PLANT_TOKEN "{about.get("instantiationToken")}"\n'
        f"#define SW_PLANT_VARIABLES {len(variables)}u\n"
        f"#define SW_PLANT_FIRST_INPUT {inputs[0]}u\n#define SW_PLANT_LAST_INPUT {inputs[-1]}u\n"
    ).encode()
