"""The plant as an FMU: settings, a script that `pythonfmu3` runs, and a binary that first checks each call."""

import json
import shutil
import tempfile
import zipfile
from pathlib import Path
from typing import Final
from xml.etree import ElementTree

from contract.config.loading import to_tree
from contract.config.tree import Config
from contract.errors import LibraryError
from ecu.c.sources import plant_fmu_sources
from ecu.in_c.compiler import compile_c, host_compiler
from firmware_sim.fmu.descriptions import as_fmi2, xml_bytes
from firmware_sim.fmu.ecu_fmu import FLAGS, PLATFORM, platform_of, zipped
from firmware_sim.fmu.kinds import WITH_SIGNALS, FmuKind

_SETTINGS: Final = "sw_plant_settings.h"
BEHIND: Final = "pythonfmu.so"
"""File name that the FMU gives to the binary of `pythonfmu3`; the binary that checks the calls loads this file."""
_DESCRIPTION: Final = "modelDescription.xml"


def plant_fmu(config: Config, start: Path | None = None, kind: FmuKind = WITH_SIGNALS) -> bytes:
    """Return the FMU's file, after creating the plant once as a check. `start` is the file of the initial flow state;
    if None, the shipped state. Raises PlantError if the start is a state of another plant, or the plant is not stable;
    LibraryError if there is no compiler, or `pythonfmu3` has no binary for this machine; ModuleNotFoundError if
    `pythonfmu3` is not installed (extra fmu)."""
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
            raise LibraryError(f"no FMU of the plant for {PLATFORM}: pythonfmu3 brings no binary for it")
        of_pythonfmu = contents.pop(binary)
        compiled = folder / "front.so"
        front = plant_fmu_sources(*kind.sources[1:]) | {_SETTINGS: _settings(about)}
        compile_c(front, compiled, compiler=host_compiler(), flags=(*FLAGS, "-ldl"))
        place, described = f"binaries/{platform_of(PLATFORM, kind)}", as_fmi2(about) if kind.fmi2 else about
        own = {f"{place}/{Path(binary).name}": compiled.read_bytes(), f"{place}/{BEHIND}": of_pythonfmu}
        return zipped(contents | {_DESCRIPTION: xml_bytes(described)} | own)


def _settings(about: ElementTree.Element) -> bytes:
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
