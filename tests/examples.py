"""How many examples a property test takes."""

from typing import Any

from hypothesis import settings


def examples(count: int, **others: Any) -> settings:
    """So many of them; in `make test` and `make check`, whose profiles take fewer by default, in proportion."""
    # The profile `drawn` in `tests/conftest.py` takes 100.
    return settings(max_examples=max(5, count * settings().max_examples // 100), **others)
