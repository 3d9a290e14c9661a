"""The finished parts of a long study, stored in files, so that an interrupted study can be continued."""

import json
from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path
from typing import Any

from benchmarks.common.command_line import track
from contract.atomic import replacing
from contract.side_by_side import process_pool


def part(path: Path, make: Callable[[], Any]) -> Any:
    """Return the finished part stored in a file, as plain values for JSON; a missing part is computed and stored."""
    if not path.is_file():
        made = make()
        path.parent.mkdir(parents=True, exist_ok=True)
        with replacing(path) as temporary:
            temporary.write_text(json.dumps(made), encoding="utf-8")
    return json.loads(path.read_text(encoding="utf-8"))


def kept_runs(
    run: Callable[..., Any], arguments: Mapping[Path, tuple[Any, ...]], *, workers: int, label: str
) -> list[Any]:
    """Return the results of all runs, in order. `arguments` maps the results file of each run to the arguments of
    `run`. Missing results are computed in `workers` processes."""
    missing = [path for path in arguments if not path.is_file()]
    # A process takes seconds to start, so none is started if the results of all runs are stored.
    if missing:
        with process_pool(min(workers, len(missing))) as pool:
            given = (arguments[path] for path in missing)
            list(track(pool.map(partial(_keep, run), missing, given), label, "runs", len(missing)))
    return [json.loads(path.read_text(encoding="utf-8")) for path in arguments]


def _keep(run: Callable[..., Any], path: Path, arguments: tuple[Any, ...]) -> None:
    part(path, lambda: run(*arguments))
