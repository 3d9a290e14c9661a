"""What must be refused, in loops over many cases."""

from collections.abc import Iterator
from contextlib import contextmanager

import pytest


@contextmanager
def refused(error: type[Exception], match: str) -> Iterator[pytest.ExceptionInfo[Exception]]:
    """As `pytest.raises`; where nothing is raised, the failure names the message that the case wanted."""
    with pytest.raises(error, match=match) as caught:
        yield caught
        pytest.fail(f"nothing was raised, wanted {error.__name__}: {match}")
