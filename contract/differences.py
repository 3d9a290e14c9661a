"""A comparison of two trees of settings or facts."""

from collections.abc import Iterator, Mapping
from typing import Any


def differences(there: Any, here: Any, name: str = "") -> Iterator[tuple[str, Any, Any]]:
    """List the differences between two trees as (dotted name, value in `there`, value in `here`). None stands for a
    missing value."""
    if isinstance(there, Mapping) and isinstance(here, Mapping):
        for key in sorted(there.keys() | here.keys()):
            yield from differences(there.get(key), here.get(key), f"{name}.{key}".lstrip("."))
    elif there != here:
        yield name, there, here
