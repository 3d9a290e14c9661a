"""Faults that are planted in the store's C, one at a time: the comparison, or the cuts, have to notice every one."""

import tomllib
from pathlib import Path
from typing import Final

from tests.proofs.ecu_in_c.planted import Planted
from tests.proofs.loader_in_c.store_library import Library, built, sources
from tests.proofs.loader_in_c.store_pair import Pair
from tests.proofs.loader_in_c.store_stories import Cuts, any_calls, cared

PLANTED: Final = tuple(
    Planted(variant="", **item)
    for item in tomllib.loads(Path(__file__).with_suffix(".toml").read_text(encoding="utf-8"))["planted"]
)


def is_found(item: Planted, folder: Path) -> bool:
    """By calls at random, by care for records, or by cuts."""
    # A fault may look odd to the compiler.
    flags = ("-O1", "-shared", "-fPIC", "-w")
    library = Library(built(folder / f"planted_{PLANTED.index(item)}.so", item.into(sources()), flags))
    try:
        for seed in range(6):
            any_calls(Pair(library), str(seed), 150)
        cared(Pair(library))
        return bool(Cuts(library, 0, every=5).findings)
    except AssertionError:
        return True
