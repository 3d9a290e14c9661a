"""Everything about the bus that is measured rather than tested, in one file of figures.

    python -m benchmarks bus --json results/bus.json

Each part is a module of this folder, or a proof, with a function `measure`; `--part` runs some of them, for a look.
"""

from collections.abc import Callable, Mapping
from importlib import import_module
from typing import Annotated, Any, Final

import typer
from rich.table import Table

from benchmarks.common.command_line import JsonFile, console, progress, save
from contract.errors import ConfigError
from contract.results import versions
from stillwake.console.terminal import progress_bar

PARTS: Final[Mapping[str, str]] = {
    "codec": "messages written and read, beside cantools",
    "flips": "bits flipped, random bytes",
    "forgeries": "forged, replayed and reflected frames",
    "fuzz": "anything on the wire",
    "response_time": "random message sets, simulated and bounded",
    "gate_mutation": "faults planted in the command gate",
}
MODULES: Final[Mapping[str, str]] = {"gate_mutation": "tests.proofs.gate.mutation"}
"""Of parts that are proofs."""
HEADLINES: Final[Mapping[str, str]] = {
    "codec_times_cantools": "codec: times as fast as cantools, at least",
    "flips_accepted": "frames with one to three flipped bits accepted",
    "random_accepted_per_million": "random frames accepted, per million, E2E profile 5",
    "authenticated_forgeries_accepted": "forgeries accepted in the authenticated mode",
    "fuzz_frames": "frames of the fuzz",
    "response_time_violations": "simulated response times past the analysis",
    "gate_mutants": "faults planted in the command gate",
    "gate_mutants_survived": "of these, not found by a test",
}


def main(
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
    with progress_bar("steps", console=progress) as bar:
        for name in part or PARTS:
            task = bar.add_task(PARTS[name], total=None, note="")

            def show(done: int, total: int, task: Any = task) -> None:
                bar.update(task, completed=done, total=total)

            measure: Callable[..., dict[str, Any]] = import_module(MODULES.get(name, f"benchmarks.bus.{name}")).measure
            found = measure(progress=show)
            # The headline figures stand alone, what is behind them under the name of its part.
            figures |= {key: value for key, value in found.items() if key in HEADLINES}
            figures[name] = {key: value for key, value in found.items() if key not in HEADLINES}
    table = Table("bus", "")
    for name, text in HEADLINES.items():
        if name in figures:
            table.add_row(text, f"{figures[name]:g}")
    console.print(table)
    facts = {"versions": versions("stillwake", "python-can", "cantools", "cryptography", "autosar-e2e")}
    save(json_file, figures=figures, facts=facts)
