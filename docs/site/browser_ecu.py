"""A page of the site that runs the exported ECU in the reader's browser: `try/index.html`.

The shipped release's ECU in C is compiled to WebAssembly, without a C library. One script contains the ECU, data about
the ECU and the recorded drives, because a page that is opened from a disk cannot read files other than scripts.
"""

import base64
import hashlib
import json
import shutil
import tempfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

import cantools
import numpy as np
from sphinx.application import Sphinx
from sphinx.util import logging

from can_bridge.e2e.profiles import profile_of
from can_bridge.wire.message_sets import message_set
from can_bridge.wire.message_specs import FLOW_RESOLUTION_M2_PER_S
from can_bridge.wire.messages import Mode, Reason
from contract.config.loading import load_config
from contract.config.tree import Config
from contract.controller.c_folder import library_sources
from contract.controller.calibration import LARGEST_WEIGHT
from contract.controller.interface import TERMS
from contract.errors import LibraryError, install
from contract.recording import dataset
from contract.recording.episode import Episode
from contract.release.checks import Bundle, dbc_bytes
from contract.shipped import recording
from ecu.calibrating import release_calibration
from ecu.fail_safe import OperatingMode
from ecu.in_c.c_ecu import ecu_sources
from ecu.in_c.c_structs import Structs
from ecu.in_c.compiler import compile_c, host_compiler, zig_compiler
from firmware_sim.runs.reasons import BECAUSE
from stillwake.parts.c_release import library_folder
from stillwake.parts.releases import open_release

ROOT: Final = Path(__file__).resolve().parents[2]
OWN: Final = ROOT / "docs" / "browser"
LIVE: Final = ROOT / "firmware_sim" / "live" / "page"
SHARED: Final = (
    *("vendor/uPlot.iife.min.js", "vendor/uPlot.min.css", "widgets/theme.css", "widgets/widgets.css"),
    *("live.css", "fields.js", "headline.js"),
    *(f"widgets/{name}.js" for name in ("format", "colours", "frames", "chart", "state_machine", "event_log")),
)
"""Files that this page shares with the live page."""
DRIVES: Final = {"controlled_2_0": "under an earlier controller", "none_0": "without jets"}
"""Episodes of the shipped recording, with the names that the page shows."""
PERIODS: Final = 1100
"""Length of a drive in control periods; a drive lasts 22 s."""
EXPORTS: Final = ("sw_ecu_init", "sw_ecu_step", "sw_ecu_calibrate", "sw_ecu_bytes", "sw_e2e_protect", "__heap_base")
FLAGS: Final = (
    *("-target", "wasm32-freestanding", "-O3", "-msimd128", "-mbulk-memory", "-ffp-contract=off", "-ffreestanding"),
    *("-nostdlib", "-Wl,--no-entry", "-Wl,--strip-all", *(f"-Wl,--export={name}" for name in EXPORTS)),
)
"""Flags of the compiler. They forbid contraction and reordering, so that all machines compute the same commands."""


def write_page(folder: Path, sources: Mapping[str, bytes], release: Bundle, config: Config) -> None:
    """Write the page and its program into a folder; `sources` are as of `ecu.in_c.c_ecu.ecu_sources`. Raises
    LibraryError as `compiled` does; StillwakeError if the shipped recording is not installed."""
    folder.mkdir(parents=True, exist_ok=True)
    for path in (*(LIVE / name for name in SHARED), *OWN.iterdir()):
        shutil.copy(path, folder / path.name)
    program = {"wasm": _text(compiled(sources)), "facts": facts(sources, release, config)}
    (folder / "program.js").write_text(f"globalThis.stillwakeProgram = {json.dumps(program)};\n", encoding="utf-8")


def compiled(sources: Mapping[str, bytes]) -> bytes:
    """Return the ECU as WebAssembly. Raises LibraryError if `ziglang` is not installed, or the sources do not
    compile."""
    compiler = zig_compiler()
    if compiler is None:
        raise LibraryError(f"the compiler for WebAssembly is missing: {install('mcu')}")
    with tempfile.TemporaryDirectory() as place:
        output = Path(place, "ecu.wasm")
        compile_c(library_sources(sources), output, compiler=compiler, flags=FLAGS)
        return output.read_bytes()


def facts(sources: Mapping[str, bytes], release: Bundle, config: Config) -> dict[str, Any]:
    """Return the data that the page needs about the release, the vehicle, the messages and the ECU's memory."""
    manifest, point, messages = release.manifest, config.operating_point, message_set(config.bus)
    database = cantools.database.load_string(dbc_bytes().decode("utf-8"), "dbc")
    assert isinstance(database, cantools.database.Database)
    named = {}
    for name, spec in zip(("pressure", "speed", "command", "status"), messages.specs, strict=True):
        signals = database.get_message_by_frame_id(spec.frame_id).signals
        named[name] = {
            "id": spec.frame_id,
            "bytes": spec.length,
            "data_id": spec.data_id,
            "counters": profile_of(spec).counter_period,
            "signals": {one.name: [one.start, one.length, one.is_signed, one.scale] for one in signals},
        }
    speeds = manifest.speeds
    return {
        "release": manifest.name,
        "sensors": manifest.sensors,
        "period_ns": config.period_ns,
        "speed": point.speed,
        "speeds": None if speeds is None else [speeds.slowest * point.speed, speeds.fastest * point.speed],
        "pressure_limit": round(messages.pressure_limit_pa / messages.pressure_resolution_pa),
        "action_limit": config.flow.action_limit * point.flow_rate_scale,
        "is_fd": messages.pressure.spec.is_fd,
        "messages": named,
        "modes": {mode.value: mode.name for mode in Mode},
        "states": [mode.name for mode in OperatingMode],
        "reasons": {reason.value: [reason.name, text] for reason, text in BECAUSE.items()},
        "none": int(Reason.NONE),
        "terms": TERMS,
        "largest_weight": LARGEST_WEIGHT,
        "calibration": release_calibration(release, config).values,
        "layout": layout(sources),
        "drives": drives(manifest.sensors, config),
    }


def layout(sources: Mapping[str, bytes]) -> dict[str, int]:
    """Return sizes of C structures and offsets of their members, in bytes. They are equal on every machine."""
    ffi = Structs(sources, host_compiler()).ffi
    members = ("timestamp_ns", "id", "is_extended", "is_fd", "length", "data")
    return {
        **{name: ffi.offsetof("sw_frame", name) for name in members},
        "frame": ffi.sizeof("sw_frame"),
        "calibration": ffi.sizeof("sw_calibration"),
        "mode": ffi.offsetof("sw_ecu", "state", "fail_safe", "mode"),
    }


def drives(sensors: tuple[str, ...], config: Config) -> list[dict[str, Any]]:
    """Return the recorded drives: pressures at the sensors and commands, as multiples of their messages' resolution."""
    data, point, messages = dataset.read(recording()), config.operating_point, message_set(config.bus)
    columns = data.layout.indices(sensors)

    def drive(episode: Episode) -> dict[str, Any]:
        pascal = np.asarray(episode.series["Cp"])[:PERIODS, columns] * point.dynamic_pressure
        flow = np.asarray(episode.series["action"])[:PERIODS] * point.flow_rate_scale
        return {
            "label": DRIVES[episode.name],
            "pressures": _steps(pascal / messages.pressure_resolution_pa),
            "flow": _steps(flow / FLOW_RESOLUTION_M2_PER_S),
        }

    named = {episode.name: episode for episode in data.episodes}
    return [drive(named[name]) for name in DRIVES]


def _steps(values: np.ndarray[Any, Any]) -> str:
    return _text(np.rint(values).astype("<i2").tobytes())


def _text(content: bytes) -> str:
    return base64.b64encode(content).decode("ascii")


def setup(app: Sphinx) -> dict[str, Any]:
    """Register `_write`, which writes the page after Sphinx has completed the site."""
    app.connect("build-finished", _write)
    return {"parallel_read_safe": True, "parallel_write_safe": True}


def _write(app: Sphinx, failure: Exception | None) -> None:
    if failure is not None or app.builder.name != "html":
        return
    folder, key, config = Path(app.outdir) / "try", _key(), load_config()
    made_of = folder / "made_of.txt"
    if made_of.is_file() and made_of.read_text(encoding="utf-8") == key:
        return
    logging.getLogger(__name__).info("the ECU for the browser is exported and compiled, which takes two minutes")
    release = open_release(None)
    with library_folder(None) as library:
        write_page(folder, ecu_sources(library, release, config), release, config)
    made_of.write_text(key, encoding="utf-8")


def _key() -> str:
    found = hashlib.sha256(open_release(None).digest.encode())
    for place in (ROOT / "ecu", ROOT / "export", LIVE, OWN, Path(__file__)):
        for path in sorted(place.rglob("*")) if place.is_dir() else [place]:
            if path.is_file() and "__pycache__" not in path.parts:
                found.update(path.name.encode() + path.read_bytes())
    return found.hexdigest()
