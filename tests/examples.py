"""How many examples a property test takes."""

from typing import Any

from hypothesis import settings

_USUAL = 100
"""Of the profile `drawn` in `tests/conftest.py`."""


def examples(count: int, **others: Any) -> settings:
    """So many of them; in `make test` and `make check`, whose profiles take fewer by default, in proportion."""
    return settings(max_examples=max(5, count * settings().max_examples // _USUAL), **others)
