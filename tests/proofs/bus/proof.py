"""What is done to the bus on purpose, in one file of figures; `--part` runs some parts of it, for a look."""

from collections.abc import Callable, Mapping
from typing import Annotated, Any, Final

import typer

from contract.errors import ConfigError
from tests.proofs.bus import forgeries, fuzz
from tests.proofs.command_line import JsonFile, report
from tests.proofs.gate import mutation

PARTS: Final[Mapping[str, tuple[Callable[[], dict[str, Any]], tuple[str, ...]]]] = {
    "forgeries": (forgeries.measure, ("authenticated_forgeries_accepted",)),
    "fuzz": (fuzz.measure, ("fuzz_frames",)),
    "gate_mutation": (mutation.measure, ("gate_mutants", "gate_mutants_survived")),
}
"""How each part is measured, and its headline figures."""


def bus(
    json_file: JsonFile = None,
    part: Annotated[list[str], typer.Option(help="Only this part (repeatable).")] = [],  # noqa: B006
) -> None:
    """Forge, garble and mutate messages on the bus, and print the headline figures."""
    for name in part:
        if name not in PARTS:
            raise ConfigError(f"--part {name}: must be one of {', '.join(PARTS)}")
    if part and json_file is not None:
        raise ConfigError("--json takes all parts: leave out --part")
    figures: dict[str, Any] = {}
    headlines: list[str] = []
    for name in part or PARTS:
        measure, own = PARTS[name]
        measured = measure()
        # The headline figures stand alone, what is behind them under the name of its part.
        figures |= {key: measured.pop(key) for key in own} | {name: measured}
        headlines += own
    packages = ("stillwake", "python-can", "cantools", "cryptography", "autosar-e2e")
    report(json_file, "bus", figures, shown=headlines, packages=packages)
