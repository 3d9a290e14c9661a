"""The wheel of the base install is a vehicle's: run by `make pristine` on what `pip wheel` made.

    python tests/install/check_wheel.py FOLDER

Ends with status 1 and one line if the folder's one wheel holds data of the laboratory or lacks what a vehicle reads.
"""

import sys
import zipfile
from pathlib import Path

MOST_BYTES = 1_600_000
"""Sources have 1.4 MB, with the loader in C, the shipped bundle 0.1. A recording or a flow state would burst it."""
DATA = (".h5", ".npz", ".npy", ".hdf5")
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
    """Look, and exit with the first thing that is wrong."""
    (wheel,) = folder.glob("stillwake-*.whl")
    with zipfile.ZipFile(wheel) as archive:
        names = archive.namelist()
    size = wheel.stat().st_size
    data = [name for name in names if name.endswith(DATA)]
    if data:
        sys.exit(f"{wheel.name} holds {', '.join(data)}: that is stillwake-data's")
    missing = [name for name in NEEDED if name not in names]
    if missing:
        sys.exit(f"{wheel.name} lacks {', '.join(missing)}")
    if size > MOST_BYTES:
        sys.exit(f"{wheel.name} has {size} bytes: at most {MOST_BYTES}")
    sys.stdout.write(f"{wheel.name}: {size} bytes, {len(names)} files\n")


if __name__ == "__main__":
    main(Path(sys.argv[1]))
