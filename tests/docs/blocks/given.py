"""What the commands of a page find in their folder: files that the reader has, made small."""

import re
import shutil
from collections.abc import Callable, Iterator
from itertools import pairwise
from pathlib import Path
from typing import Final, NamedTuple

import numpy as np
from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey

from can_bridge.secoc.key import write_key
from contract.release import bundle as bundles
from contract.release.signing import read_private_key, write_key_pair
from contract.shipped import MODEL
from tests.can_bridge.drives.drive_log import drive, log_of
from tests.can_bridge.logs.log_texts import write
from tests.conftest import SIGNING_KEY
from tests.docs.blocks.pages import ROOT, Line

_WRITES: Final = re.compile(
    r"stillwake (?:keygen --secret|keygen|bundle keylist|dataset import|ecu provision|run|train|record|"
    r"develop|export \S+|bundle renew \S+) (?P<output>\S+)"
)
_SENSORS: Final = (
    "name,x,y,base\nlower_36,6.9125,-0.5,0\nbase_7,7.647,-0.2045,1\nupper_39,7.4634,0.5,0\nbase_0,7.647,0.3682,1\n"
)
_BEFORE_OUTPUTS: Final = ("--csv", "--json", "--picture", "--output", "--frames", "--c")
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


class Shared(NamedTuple):
    """What is expensive, made once: a bundle, the folder of a run with it, a C library, and a recording."""

    bundle: Path
    run: Path
    library: Path
    recording: Path


Maker = Callable[[Path, Shared], object]


def _keys(path: Path, shared: Shared) -> None:
    write_key_pair(path.parent if path.suffix in (".key", ".pub") else path, Ed25519PrivateKey.generate())


def _maker(path: Path, shared: Shared) -> None:
    """The public key of who signed the bundle that is there."""
    bundles.sign(path.with_name("runs") / "bundle", SIGNING_KEY)
    write_key_pair(path.with_name("of_the_maker"), SIGNING_KEY)
    (path.with_name("of_the_maker") / "release.pub").rename(path)


def _signed(path: Path, shared: Shared) -> None:
    """A bundle signed by the key that its page made."""
    shutil.copytree(shared.bundle, path)
    bundles.sign(path, read_private_key(path.parents[1] / "keys" / "release.key"))


def _series(path: Path, shared: Shared) -> None:
    """Signals of the sensors in sensors.csv, at its page's period: 0.3 where the page's own sensors are few."""
    names = [row.split(",")[0] for row in path.with_name("sensors.csv").read_text().split("\n")[1:] if row]
    period, limit = (0.3, 0.2) if "roof 1" in names else (0.2, 0.075)
    generator = np.random.default_rng(len(path.name))
    t = period * np.arange(_ROWS)
    phase = 2 * np.pi * 0.2 * t + 0.5 * np.sin(t / 7.0)
    action = 0.9 * limit * np.sin(phase) * ("calm" not in path.name)
    walls = [-0.3 + 0.1 * np.sin(phase + k) + 1e-3 * generator.normal(size=_ROWS) for k in range(len(names))]
    columns = [t, action, 1.2 + 0.1 * np.cos(2 * phase), np.sin(phase + 0.3), *walls]
    _table(path, ",".join(["t", "action", "Cd", "Cl", *names]), columns)


def _forces(path: Path, shared: Shared) -> None:
    t = 0.05 * np.arange(-4, 4 * _ROWS + 4)
    _table(path, "t [t_c],Cd,Cl", [t, 1.0 + 0.1 * np.sin(t), np.cos(t)])


def _table(path: Path, header: str, columns: list[np.ndarray]) -> None:
    np.savetxt(path, np.column_stack(columns), delimiter=",", header=header, comments="")


MAKERS: Final[dict[str, Maker]] = {
    "run": lambda path, shared: shutil.copytree(shared.run, path),
    "bundle": lambda path, shared: shutil.copytree(shared.bundle, path),
    "signed": _signed,
    "model": lambda path, shared: shutil.copytree(MODEL, path),
}
GIVEN: Final[dict[str, Maker]] = {
    r"runs/(demo|a|b)": MAKERS["run"],
    r"runs/(bundle|long)|bundle|A|B|my_bundle": MAKERS["bundle"],
    r"runs/(model|refined)": MAKERS["model"],
    r"runs/(?:ecu|own)_c": lambda path, shared: shutil.copytree(shared.library, path),
    r"(my|data)\.h5": lambda path, shared: shutil.copy(shared.recording, path),
    r"(my_|)vehicle\.dbc|engine\.dbc": lambda path, shared: path.write_text(_DBC, encoding="utf-8"),
    r"(frames|drive|other|monday|tuesday)\.blf": lambda path, shared: write(
        path, log_of(drive("fd", _ROWS, len(path.name)))
    ),
    r"(drive|other|monday|tuesday)\.csv": _forces,
    r"sensors\.csv": lambda path, shared: path.write_text(_SENSORS, encoding="utf-8"),
    r"(a|b|sweep|calm|held_out)\.csv": _series,
    r"(root|keys|maker|old)(/release\.(key|pub))?|release\.key": _keys,
    r"maker\.pub": _maker,
    r"bus\.key": lambda path, shared: write_key(path, bytes(range(1, 17))),
}
"""Paths that a page's lines read, and what makes them."""


def give(line: Line, folder: Path, shared: Shared) -> None:
    """Make what a line reads and no line before it made."""
    for part in _read(line):
        found = ((re.match(rf"(?:{form})(?=/|$)", part), maker) for form, maker in GIVEN.items())
        matched, maker = next(((match[0], maker) for match, maker in found if match), ("", None))
        path = folder / matched
        if maker is not None and not path.exists():
            path.parent.mkdir(parents=True, exist_ok=True)
            maker(path, shared)


def _read(line: Line) -> Iterator[str]:
    """The words of a line that can name what it reads, as far as they can."""
    found = _WRITES.match(line.text)
    for before, word in pairwise(line.words):
        if (found is None or word != found["output"]) and before not in _BEFORE_OUTPUTS:
            yield from word.split("=")


def begin(folder: Path, files: dict[str, str]) -> None:
    """A folder with what a checkout has for the pages' commands, and the files that the page itself shows."""
    for name in ("contract", "firmware_sim", "data", "examples"):
        (folder / name).symlink_to(ROOT / name)
    for name in ("results", "runs", "docs/pictures"):
        (folder / name).mkdir(parents=True)
    for name, text in files.items():
        (folder / name).write_text(text, encoding="utf-8")
