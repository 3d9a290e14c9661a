"""Many cases in one test item."""

import inspect
from collections.abc import Callable, Iterable
from functools import wraps
from typing import Any

Test = Callable[..., None]


def each(names: str, rows: Iterable[Any]) -> Callable[[Test], Test]:
    """Run a test once for every row of values; a failure names the row.

    Takes what `pytest.mark.parametrize` takes. The rows share the test's fixtures: use it where no row changes one.
    """
    wanted, rows = [name.strip() for name in names.split(",")], list(rows)

    def over(test: Test) -> Test:
        @wraps(test)
        def all_rows(**fixtures: Any) -> None:
            for row in rows:
                values = [row] if len(wanted) == 1 else row
                try:
                    test(**fixtures, **dict(zip(wanted, values, strict=True)))
                except BaseException as error:
                    error.add_note(f"with {names} = {row!r}")
                    raise

        signature = inspect.signature(test)
        left = [item for name, item in signature.parameters.items() if name not in wanted]
        all_rows.__signature__ = signature.replace(parameters=left)  # type: ignore[attr-defined]
        return all_rows

    return over
