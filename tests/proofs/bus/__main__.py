"""What is done to the bus on purpose, in one file of figures.

    python -m tests.proofs.bus bus --json results/bus.json

Each part is a module with a function `measure`; `--part` runs some of them, for a look.
"""

from collections.abc import Callable, Mapping
from importlib import import_module
from typing import Annotated, Any, Final

import typer
from rich.table import Table

from contract.errors import ConfigError
from contract.results import versions
from stillwake.console.terminal import make_console, progress_bar
from tests.proofs import command_line
from tests.proofs.command_line import JsonFile, console, save

PARTS: Final[Mapping[str, tuple[str, tuple[str, ...]]]] = {
    "codec": ("tests.proofs.bus.codec", ("codec_times_cantools",)),
    "flips": ("tests.proofs.bus.flips", ("flips_accepted", "random_accepted_per_million")),
    "forgeries": ("tests.proofs.bus.forgeries", ("authenticated_forgeries_accepted",)),
    "fuzz": ("tests.proofs.bus.fuzz", ("fuzz_frames",)),
    "response_time": ("tests.proofs.bus.response_time", ("response_time_violations",)),
    "gate_mutation": ("tests.proofs.gate.mutation", ("gate_mutants", "gate_mutants_survived")),
}
"""Module and headline figures of each part."""


def bus(
    json_file: JsonFile = None,
    part: Annotated[list[str], typer.Option(help="Only this part (repeatable).")] = [],  # noqa: B006
) -> None:
    """Run all parts and print the headline figures."""
    for name in part:
        if name not in PARTS:
            raise ConfigError(f"--part {name}: must be one of {', '.join(PARTS)}")
    if part and json_file is not None:
        raise ConfigError("--json takes all parts: leave out --part")
    figures: dict[str, Any] = {}
    table = Table("bus", "")
    with progress_bar("steps", console=make_console(stderr=True)) as bar:
        for name in part or PARTS:
            task = bar.add_task(name.replace("_", " "), total=None, note="")

            def show(done: int, total: int, task: Any = task) -> None:
                bar.update(task, completed=done, total=total)

            module, headlines = PARTS[name]
            measure: Callable[..., dict[str, Any]] = import_module(module).measure
            measured = measure(progress=show)
            # The headline figures stand alone, what is behind them under the name of its part.
            figures |= {key: measured[key] for key in headlines}
            figures[name] = {key: value for key, value in measured.items() if key not in headlines}
            for key in headlines:
                table.add_row(key.replace("_", " "), f"{figures[key]:g}")
    console.print(table)
    facts = {"versions": versions("stillwake", "python-can", "cantools", "cryptography", "autosar-e2e")}
    save(json_file, figures=figures, facts=facts)


if __name__ == "__main__":
    command_line.main({"bus": bus})
