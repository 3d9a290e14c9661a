"""The wheel of the base install is a vehicle's: run by `make pristine` on what `pip wheel` made.

    python tests/install/check_wheel.py FOLDER

Ends with status 1 and one line if the folder's one wheel holds data of the laboratory or lacks what a vehicle reads.
"""

import sys
import zipfile
from pathlib import Path

MOST_BYTES = 1_670_000
"""Sources and their listing have 1.57 MB, whose lines tests/test_house.py counts, and the models 0.08."""
MOST_MODEL_BYTES = 110_000
"""The shipped bundle's two graphs have 82 kB as they lie in the archive."""
MODEL = ".onnx"
SOURCES = (".py", ".c", ".h", ".ld", ".js", ".css", ".html", ".svg", ".md", ".txt", ".j2", ".typed")
TABLES = (".toml", ".yml", ".xml", ".json", ".dbc", ".a2l", ".odx-c", ".odx-cs", ".odx-d", ".odx-f")
PAPERS = (".sig", ".pub", "LICENSE", "METADATA", "WHEEL", "RECORD")
TEXT = (*SOURCES, *TABLES, *PAPERS)
"""The ends of names in which no recording, flow state or trained network is stored."""
NEEDED = (
    "contract/stillwake.dbc",
    "contract/release/release.pub",
    "contract/config/quick.toml",
    "contract/config/release.toml",
    "contract/config/trained.toml",
    "contract/release/shipped/controller.onnx",
    "contract/release/shipped/manifest.json",
    "contract/release/shipped/manifest.sig",
    "export/to_c/sources/step/stillwake.h",
)


def main(folder: Path) -> None:
    (wheel,) = folder.glob("stillwake-*.whl")
    with zipfile.ZipFile(wheel) as archive:
        names = archive.namelist()
        models = sum(file.compress_size for file in archive.infolist() if file.filename.endswith(MODEL))
    size = wheel.stat().st_size
    data = [name for name in names if not name.endswith((*TEXT, MODEL))]
    if data:
        sys.exit(f"{wheel.name} holds {', '.join(data)}: that is stillwake-data's")
    missing = [name for name in NEEDED if name not in names]
    if missing:
        sys.exit(f"{wheel.name} lacks {', '.join(missing)}")
    if models > MOST_MODEL_BYTES:
        sys.exit(f"{wheel.name} has models of {models} bytes: at most {MOST_MODEL_BYTES}")
    if size > MOST_BYTES:
        sys.exit(f"{wheel.name} has {size} bytes: at most {MOST_BYTES}")
    sys.stdout.write(f"{wheel.name}: {size} bytes, {len(names)} files\n")


if __name__ == "__main__":
    main(Path(sys.argv[1]))
