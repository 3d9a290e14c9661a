"""What the commands of a page find in their folder: files that the reader has, made small."""

import re
import shutil
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path
from typing import Final

import numpy as np
from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey

from can_bridge.secoc.key import write_key
from contract.recording import dataset
from contract.release import bundle as bundles
from contract.release.signing import read_private_key, write_key_pair
from contract.shipped import MODEL, RECORDING
from tests.can_bridge.drives.drive_log import drive, log_of, write
from tests.conftest import SIGNING_KEY
from tests.docs.blocks.lines import Line
from tests.docs.blocks.pages import ROOT
from tests.firmware_sim.ecu_in_c import exported

CHECKOUT: Final = ("contract", "firmware_sim", "data", "examples")
"""Folders of the checkout that the pages' commands read."""

_WRITES: Final = re.compile(
    r"stillwake (?:can keygen|bundle keygen|bundle keylist|dataset import|ecu provision|run|train|record|"
    r"develop|export \S+|bundle renew \S+) (?P<output>\S+)(?! --show)"
)
_SENSORS: Final = "name,x,y,base\nlower_36,6.9125,-0.5,0\nbase_7,7.647,-0.2045,1\nupper_39,7.4634,0.5,0\n"
_ROWS: Final = 200
_DBC: Final = """VERSION ""
NS_ :
BS_:
BU_: Engine
BO_ 291 EngineData: 8 Engine
 SG_ EngineSpeed : 0|16@1+ (0.25,0) [0|16000] "rpm" Vector__XXX
BA_DEF_ BO_ "GenMsgCycleTime" INT 0 65535;
BA_DEF_DEF_ "GenMsgCycleTime" 0;
BA_ "GenMsgCycleTime" BO_ 291 10;
"""


@dataclass(frozen=True)
class Shared:
    """What is expensive, made once: a signed bundle, and the folder of a run with it."""

    bundle: Path
    run: Path


Maker = Callable[[Path, Shared], object]


def _copy_of(which: Callable[[Shared], Path]) -> Maker:
    return lambda path, shared: shutil.copytree(which(shared), path)


def _keys(path: Path, shared: Shared) -> None:
    folder = path.parent if path.suffix in (".key", ".pub") else path
    write_key_pair(folder, Ed25519PrivateKey.generate())


def _bus_key(path: Path, shared: Shared) -> None:
    write_key(path, bytes(range(1, 17)))


def _library(path: Path, shared: Shared) -> None:
    """A C folder with its ECU."""
    shutil.move(exported(path.with_name("of_the_library")).folder, path)


def _maker(path: Path, shared: Shared) -> None:
    """Who signed the bundle that is there."""
    bundles.sign(path.with_name("runs") / "bundle", SIGNING_KEY)
    write_key_pair(path.with_name("of_the_maker"), SIGNING_KEY)
    (path.with_name("of_the_maker") / "release.pub").rename(path)


def _series(path: Path, shared: Shared) -> None:
    """Signals of the sensors in sensors.csv, at its page's period: 0.3 where the page's own sensors are few."""
    names = [row.split(",")[0] for row in path.with_name("sensors.csv").read_text().split("\n")[1:] if row]
    own = "roof 1" in names
    period, limit = (0.3, 0.2) if own else (0.2, 0.075)
    generator = np.random.default_rng(len(path.name))
    t = period * np.arange(_ROWS)
    phase = 2 * np.pi * 0.2 * t + 0.5 * np.sin(t / 7.0)
    action = 0.9 * limit * np.sin(phase) * ("calm" not in path.name)
    walls = [-0.3 + 0.1 * np.sin(phase + k) + 1e-3 * generator.normal(size=_ROWS) for k in range(len(names))]
    table = np.column_stack([t, action, 1.2 + 0.1 * np.cos(2 * phase), np.sin(phase + 0.3), *walls])
    np.savetxt(path, table, delimiter=",", header=",".join(["t", "action", "Cd", "Cl", *names]), comments="")


def _recording(path: Path, shared: Shared) -> None:
    """The beginnings of three episodes of the shipped one."""
    whole = dataset.read(RECORDING)
    parts = [
        replace(one, series={name: values[:_ROWS] for name, values in one.series.items()})
        for one in whole.episodes
        if one.name in ("training_1", "none_0", "chirp_0")
    ]
    dataset.write(path, replace(whole, episodes=tuple(parts)))


def _forces(path: Path, shared: Shared) -> None:
    t = 0.05 * np.arange(-4, 4 * _ROWS + 4)
    table = np.column_stack([t, 1.0 + 0.1 * np.sin(t), np.cos(t)])
    np.savetxt(path, table, delimiter=",", header="t [t_c],Cd,Cl", comments="")


def _sensors(path: Path, shared: Shared) -> None:
    path.write_text(f"{_SENSORS}base_0,7.647,0.3682,1\n", encoding="utf-8")


def _drive(path: Path, shared: Shared) -> None:
    write(path, log_of(drive("fd", _ROWS, len(path.name))))


def _signed(path: Path, shared: Shared) -> None:
    """A bundle signed by the key that its page made."""
    shutil.copytree(shared.bundle, path)
    bundles.sign(path, read_private_key(path.parents[1] / "keys" / "release.key"))


MAKERS: Final[dict[str, Maker]] = {
    "run": _copy_of(lambda shared: shared.run),
    "bundle": _copy_of(lambda shared: shared.bundle),
    "signed": _signed,
    "model": lambda path, shared: shutil.copytree(MODEL, path),
    "drive": _drive,
}

GIVEN: Final[tuple[tuple[str, Maker], ...]] = (
    (r"runs/(demo|a|b)", MAKERS["run"]),
    (r"runs/(bundle|long)|bundle|A|B|my_bundle", MAKERS["bundle"]),
    (r"runs/(model|refined)", MAKERS["model"]),
    (r"(my|data)\.h5", _recording),
    (r"(my_|)vehicle\.dbc|engine\.dbc", lambda path, shared: path.write_text(_DBC, encoding="utf-8")),
    (r"(frames|drive|other|monday|tuesday)\.blf", MAKERS["drive"]),
    (r"(drive|other|monday|tuesday)\.csv", _forces),
    (r"sensors\.csv", _sensors),
    (r"(a|b|sweep|calm|held_out)\.csv", _series),
    (r"(root|keys|maker|old)(/release\.(key|pub))?|release\.key", _keys),
    (r"maker\.pub", _maker),
    (r"bus\.key", _bus_key),
    (r"runs/ecu_c", _library),
)


def give(line: Line, folder: Path, shared: Shared) -> None:
    """Make what a line reads and no line before it made."""
    for part in _read(line):
        for form, maker in GIVEN:
            matched = re.match(rf"(?:{form})(?=/|$)", part)
            if matched is None:
                continue
            path = folder / matched[0]
            if not path.exists():
                path.parent.mkdir(parents=True, exist_ok=True)
                maker(path, shared)
            break


def _read(line: Line) -> Iterator[str]:
    """The words of a line that can name what it reads, as far as they can."""
    found = _WRITES.match(line.text)
    written = {found["output"]} if found is not None else set()
    for before, word in pairwise(line.words):
        if word not in written and before not in ("--csv", "--json", "--picture"):
            yield from word.split("=")


def begin(folder: Path, files: dict[str, str]) -> None:
    """A folder with what a checkout has, and the files that the page itself shows."""
    for name in CHECKOUT:
        (folder / name).symlink_to(ROOT / name)
    for name in ("results", "runs", "docs/pictures"):
        (folder / name).mkdir(parents=True)
    for name, text in files.items():
        (folder / name).write_text(text, encoding="utf-8")
