"""How many examples a property test takes."""

from typing import Any

from hypothesis import settings

_USUAL = 100
"""Of the profile `whole` in `tests/conftest.py`."""


def examples(count: int, **others: Any) -> settings:
    """So many of them; in `make check`, whose profile takes fewer by default, fewer in the same proportion."""
    return settings(max_examples=max(5, count * settings().max_examples // _USUAL), **others)
