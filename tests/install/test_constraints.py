"""constraints.txt pins what `make test` installs, for every Python that we take."""

from importlib.metadata import PackageNotFoundError, distribution
from pathlib import Path

from packaging.requirements import Requirement
from packaging.specifiers import SpecifierSet
from packaging.utils import canonicalize_name

ROOT = Path(__file__).parents[2]
PINNED = {
    canonicalize_name(Requirement(line).name): Requirement(line)
    for line in (ROOT / "constraints.txt").read_text().splitlines()
}


def test_every_direct_dependency_is_pinned():
    direct = {canonicalize_name(Requirement(text).name) for text in distribution("stillwake").requires or []}
    assert direct - PINNED.keys() == {"stillwake"}


def test_no_pin_refuses_the_oldest_python_that_we_take():
    for name in PINNED:
        try:
            takes = str(distribution(name).metadata.json.get("requires_python", ""))
        except PackageNotFoundError:
            continue  # of another system
        assert SpecifierSet(takes).contains("3.11.0"), f"{name}: {takes}"
