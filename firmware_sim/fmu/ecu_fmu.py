"""The ECU in C as one FMU, compiled for this machine and with its sources, for any tool that imports FMI 3.0."""

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
from contract.release.checks import Bundle
from ecu.in_c.compiler import compile_c, host_compiler
from firmware_sim.fmu.ecu_variables import IDENTIFIER, ecu_variables, model_description, wrapper_settings, xml_bytes

PLATFORM: Final = f"{platform.machine()}-{sys.platform}"
"""Name of the platform in FMI, such as x86_64-linux."""
FLAGS: Final = ("-O3", "-ffp-contract=off", "-fPIC", "-shared", "-fvisibility=hidden", "-Wl,--no-undefined")
"""Flags of the compiler. -march is absent because an FMU is used on other machines; no decision depends on it."""
_SETTINGS: Final = "sw_fmu_settings.h"
_DAY: Final = (1980, 1, 1, 0, 0, 0)


def ecu_fmu(ecu: Mapping[str, bytes], wrapper: Mapping[str, bytes], bundle: Bundle, config: Config) -> bytes:
    """Return the FMU's file; equal arguments and an equal compiler give equal bytes. Raises LibraryError if there is no
    compiler, or it rejects the sources.

    Args:
        ecu: sources of a library with the ECU and its settings (`ecu.in_c.c_ecu.ecu_sources`).
        wrapper: sources of the wrapper (`ecu.c.sources.fmu_sources`).
        bundle: verified release that both are made from.
        config: settings of the vehicle that the ECU is compiled for.
    """
    sources = library_sources(ecu) | dict(wrapper)
    made_from = hashlib.sha256(repr(sorted(sources.items())).encode()).digest()
    token = f"{{{uuid.UUID(bytes=made_from[:16])}}}"
    variables = ecu_variables(bundle.manifest.sensors, config)
    sources[_SETTINGS] = wrapper_settings(variables, token, config)
    with tempfile.TemporaryDirectory() as folder:
        binary = Path(folder, f"{IDENTIFIER}.so")
        compile_c(sources, binary, compiler=host_compiler(), flags=FLAGS)
        compiled = binary.read_bytes()
    return zipped(
        {
            "modelDescription.xml": model_description(variables, token, bundle, config),
            f"binaries/{PLATFORM}/{IDENTIFIER}.so": compiled,
            "sources/buildDescription.xml": _build_description(sources),
            **{f"sources/{name}": content for name, content in sorted(sources.items())},
        }
    )


def zipped(contents: Mapping[str, bytes]) -> bytes:
    """Return a zip file with these contents, whose bytes depend on nothing else."""
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
    files = add(
        add(root, "BuildConfiguration", modelIdentifier=IDENTIFIER),
        "SourceFileSet",
        language="C99",
        compilerOptions="-ffp-contract=off",
    )
    for name in sorted(sources):
        if name.endswith(".c"):
            add(files, "SourceFile", name=name)
    return xml_bytes(root)
