"""The table of bus load and of the worst-case response times of the project's messages, with and without other
traffic."""

from pathlib import Path
from typing import Any, Final

from benchmarks.common.markdown import read, table

SETS: Final = ("fd", "classic")
HEADS: Final = (
    *("message", "bytes", "frame, ms", "response, ms", "with other traffic, ms", "deadline, ms", "in time"),
)


def tables(results: Path) -> dict[str, str]:
    """Return the table's text, by the table's name in the pages."""
    return {"can_load": can_load(results)}


def can_load(results: Path) -> str:
    """Return a table with a row for each of the project's messages, and the total load of the bus below the table."""
    rows, lines = [], []
    for name in SETS:
        alone, loaded = (read(results / f"can_load_{name}{end}.json") for end in ("", "_90"))
        others = _ours(loaded)
        for message in _ours(alone).values():
            crowded = others[message["name"]]
            rows.append(
                (
                    *(message[key] for key in ("name", "bytes", "frame_worst_ms")),
                    *(message["response_ms"], crowded["response_ms"], message["deadline_ms"]),
                    "yes" if crowded["in_time"] else "no",
                )
            )
        lines.append(
            f"{'CAN FD' if name == 'fd' else 'Classic CAN'}: stillwake's messages load the bus by {_load(alone)}, "
            f"together with {len(loaded['figures']['messages']) - len(others)} other messages by {_load(loaded)}."
        )
    return table(HEADS, rows) + "\n\n" + "\n".join(lines)


def _ours(result: Any) -> dict[str, Any]:
    return {message["name"]: message for message in result["figures"]["messages"] if message["ours"]}


def _load(result: Any) -> str:
    figures = result["figures"]
    return f"{100 * figures['load_mean']:.1f} % ({100 * figures['load_worst']:.1f} % at worst)"
