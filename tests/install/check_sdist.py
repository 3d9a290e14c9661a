"""An sdist holds what its wheel is made of and nothing else: run by `make packages` on what `python -m build` made.

    python tests/install/check_sdist.py FOLDER DIRECT

FOLDER has sdists with the wheels that were built from them, DIRECT the wheels that were built from the checkout. Ends
with status 1 and one line where the two wheels differ in their files, or the sdist has more or less than they have.
"""

import sys
import tarfile
import zipfile
from pathlib import Path

BESIDE = {"pyproject.toml", "README.md", "LICENSE", "PKG-INFO", "setup.cfg"}
"""What an sdist has at its top beside the packages: the last two are written by setuptools."""


def of_wheel(path: Path) -> set[str]:
    """The names of a wheel's files without its metadata."""
    with zipfile.ZipFile(path) as archive:
        return {name for name in archive.namelist() if ".dist-info/" not in name and not name.endswith("/")}


def of_sdist(path: Path) -> set[str]:
    """The names of an sdist's files below its one folder, without its metadata."""
    with tarfile.open(path) as archive:
        names = {member.name.partition("/")[2] for member in archive.getmembers() if member.isfile()}
    return {name for name in names if ".egg-info/" not in name and name != "MANIFEST.in"}


def refuse(what: str, found: set[str], wanted: set[str]) -> None:
    if found != wanted:
        more, less = sorted(found - wanted), sorted(wanted - found)
        sys.exit(f"{what}: {len(more)} files too many {more[:5]}, {len(less)} too few {less[:5]}")


def main(folder: Path, direct: Path) -> None:
    sdists = sorted(folder.glob("*.tar.gz"))
    if not sdists:
        sys.exit(f"{folder}: no sdist")
    for sdist in sdists:
        name = sdist.name.removesuffix(".tar.gz")
        (wheel,), (straight,) = folder.glob(f"{name}-*.whl"), direct.glob(f"{name}-*.whl")
        files = of_wheel(wheel)
        refuse(f"{wheel.name} from the sdist, beside that from the checkout", files, of_wheel(straight))
        refuse(sdist.name, of_sdist(sdist), files | BESIDE)
        sys.stdout.write(f"{sdist.name}: {sdist.stat().st_size} bytes, {len(files)} files as in the wheel\n")


if __name__ == "__main__":
    main(Path(sys.argv[1]), Path(sys.argv[2]))
