"""Everything that a run was made with, as names and values: to be printed, and to be compared."""

from collections.abc import Iterator, Mapping
from typing import Any, Final

from contract.config import loading
from firmware_sim.runs.metadata import RunMetadata

_UNUSED: Final = ("forcing", "model", "train", "mpc")
"""Sections of the settings that a run does not read; the bundle has its own `mpc`."""


def settings_of(run: RunMetadata) -> dict[str, str]:
    """Every setting of a run by its name in TOML with dots, the optimiser's as in the bundle, weights as in force."""
    used = {name: value for name, value in loading.to_tree(run.config).items() if name not in _UNUSED}
    tree = run.to_tree()
    built = tree["mpc"] | {"weights": tree["weights"]}
    return {name: str(value) for name, value in (*leaves(used), *leaves({"mpc": built}))}


def settings_lines(run: RunMetadata) -> list[str]:
    """The settings, then the versions, for a page."""
    return [
        *(f"{name} = {value}" for name, value in settings_of(run).items()),
        *(f"{name} {value}" for name, value in run.versions.items()),
    ]


def leaves(tree: Mapping[str, Any], above: str = "") -> Iterator[tuple[str, Any]]:
    """(name with dots, value) of every value in nested mappings."""
    for name, value in tree.items():
        if isinstance(value, Mapping):
            yield from leaves(value, f"{above}{name}.")
        else:
            yield f"{above}{name}", value
