"""The plant as an FMU: a script for `pythonfmu3` with its settings, to be run in the importing tool's Python."""

import json
import shutil
import tempfile
from pathlib import Path

from contract.config.loading import to_tree
from contract.config.tree import Config


def plant_fmu(config: Config, start: Path | None = None) -> bytes:
    """The FMU's file, after the plant has been made once. Raises PlantError if the start is not of this plant, or the
    plant not stable; ModuleNotFoundError if `pythonfmu3` is not installed (extra fmu).

    Args:
        config: of flow, body and operating point; the rest goes along.
        start: flow state to begin from; the shipped one without it.
    """
    from pythonfmu3.builder import FmuBuilder

    from firmware_sim.fmu import plant_slave

    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        files = [folder / plant_slave.SETTINGS]
        files[0].write_text(json.dumps(to_tree(config)), encoding="utf-8")
        if start is not None:
            files.append(folder / plant_slave.START)
            shutil.copyfile(start, files[-1])
        script = Path(plant_slave.__file__)
        made = FmuBuilder.build_FMU(
            script, folder, files, canGetAndSetFMUState=True, canHandleVariableCommunicationStepSize=False
        )
        return Path(made).read_bytes()
