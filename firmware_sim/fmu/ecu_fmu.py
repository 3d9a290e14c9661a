"""The ECU in C as one FMU, with its compiled library and its sources, for any tool that imports FMI 3.0 or 2.0."""

import hashlib
import platform
import sys
import tempfile
import uuid
import zipfile
from collections.abc import Mapping
from io import BytesIO
from pathlib import Path
from typing import Final
from xml.etree import ElementTree

from contract.config.tree import Config
from contract.controller.c_folder import library_sources
from contract.errors import ConfigError, LibraryError
from contract.release.checks import Bundle
from ecu.c.sources import fmu_sources
from ecu.in_c.compiler import compile_c, host_compiler, zig_compiler
from firmware_sim.fmu.descriptions import as_fmi2, bus_files, model_description, xml_bytes
from firmware_sim.fmu.ecu_variables import IDENTIFIER, ecu_variables, wrapper_settings
from firmware_sim.fmu.kinds import WITH_SIGNALS, FmuKind

PLATFORM: Final = f"{platform.machine()}-{sys.platform}"
"""Name of this machine's platform in FMI 3.0, such as x86_64-linux."""
WINDOWS_64: Final = "x86_64-windows"
PLATFORMS_2: Final = {"x86_64-linux": "linux64", "x86_64-darwin": "darwin64", WINDOWS_64: "win64"}
"""Names of platforms in FMI 2.0 by their names in FMI 3.0. All other names are equal in both."""
FLAGS: Final = ("-O3", "-ffp-contract=off", "-fPIC", "-shared", "-fvisibility=hidden", "-Wl,--no-undefined")
"""Flags of the compiler, without -march, because an FMU may run on other machines."""
_FLAGS_WINDOWS: Final = ("-target", f"{WINDOWS_64}-gnu", "-O3", "-ffp-contract=off", "-shared", "-s")
_SETTINGS: Final = "sw_fmu_settings.h"
_DAY: Final = (1980, 1, 1, 0, 0, 0)


def ecu_fmu(ecu: Mapping[str, bytes], bundle: Bundle, config: Config, kind: FmuKind = WITH_SIGNALS) -> bytes:
    """Return the FMU's file; equal arguments and an equal compiler give equal bytes. `ecu` has the
    `ecu.in_c.c_ecu.ecu_sources` of this verified release and vehicle. Raises LibraryError if there is no compiler, or
    the compiler rejects the sources; ConfigError if the step offset or the compute time is not shorter than the control
    period."""
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
    """Return the compiled libraries by their paths in the FMU: for this machine and, if asked for, Windows."""
    made = {PLATFORM: (host_compiler(), FLAGS, "so")}
    if kind.windows:
        zig = zig_compiler()
        if zig is None:
            raise LibraryError("no FMU for Windows without ziglang: pip install '.[mcu]'")
        made[WINDOWS_64] = zig, _FLAGS_WINDOWS, "dll"
    found = {}
    for name, (compiler, flags, ending) in made.items():
        with tempfile.TemporaryDirectory() as folder:
            binary = Path(folder, f"{IDENTIFIER}.{ending}")
            compile_c(sources, binary, compiler=compiler, flags=flags)
            found[f"binaries/{platform_of(name, kind)}/{binary.name}"] = binary.read_bytes()
    return found


def platform_of(name: str, kind: FmuKind) -> str:
    """Return the name of the folder that contains a platform's library."""
    return PLATFORMS_2.get(name, name) if kind.fmi2 else name


def zipped(contents: Mapping[str, bytes]) -> bytes:
    """Return a zip file with these contents; its bytes depend only on the contents."""
    file = BytesIO()
    with zipfile.ZipFile(file, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, content in contents.items():
            info = zipfile.ZipInfo(name, _DAY)
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
