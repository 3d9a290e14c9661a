"""An ECU and a vehicle against a hostile bus, clock and controller, by chance, a million control periods long.

    python -m tests.proofs.ecu hostile --steps 1000000 --json results/hostile.json

Whether a promise is kept is judged from outside, see `promises`. The same seed and number of steps give the same
periods on one process as on many.
"""

import resource
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from functools import partial
from typing import Annotated, Any, Final

import typer
from rich.table import Table

from contract.config.tree import Config
from contract.config.vehicle import EcuConfig
from contract.results import versions
from tests.proofs.command_line import JsonFile, Processes, console, save, spread, track
from tests.proofs.ecu import wire_witness as wire
from tests.proofs.ecu.hostile_world import RandomEvents, World
from tests.proofs.ecu.promises import PROMISES

SETTINGS: Final = {
    "as they are": EcuConfig(),
    "not planning ahead": EcuConfig(plan_ahead=False),
    "an actuator two periods late": EcuConfig(delay_steps=2),
    "patient": EcuConfig(hold_periods=3, decay_periods=3, loss_limit=50, deadline_misses=11, rearm_frames=1),
    "impatient": EcuConfig(hold_periods=0, decay_periods=0, loss_window=10, loss_limit=2, pressure_age=1.0),
}
"""Settings of the ECU, in turn."""
STRETCH: Final = 5_000
"""Periods in which one pair of nodes lives; each stretch has a seed of its own."""


@dataclass(frozen=True, kw_only=True)
class Stretch:
    """What one stretch came to.

    Attributes:
        periods: lived through.
        broken: how often each promise was.
        modes: ECU's steps in each mode.
        driven: periods in which the jets ran.
        first: the first violations, in words.
        rss_kib: memory of the process at its end, at most so far.
    """

    periods: int
    broken: Counter[str]
    modes: Counter[str]
    driven: int
    first: tuple[str, ...]
    rss_kib: int


def stretch(number: int, *, seed: int, periods: int = STRETCH) -> Stretch:
    """Live through one; `number` chooses settings and, with `seed`, what happens."""
    name = list(SETTINGS)[number % len(SETTINGS)]
    world, events = World(Config(ecu=SETTINGS[name])), RandomEvents(f"{seed} {number}")
    broken, modes, first, driven = Counter[str](), Counter[str](), list[str](), 0
    for _ in range(periods):
        found = world.period(events.next(world.now_ns))
        seen = world.seen
        driven += seen.action != 0.0
        if seen.answers:
            modes[world.ecu.trace.mode.name] += 1
        if found:
            broken.update(found)
            first.append(f"stretch {number} ({name}), period {seen.period}: {', '.join(found)}{_of(seen.error)}")
    rss_kib = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return Stretch(periods=periods, broken=broken, modes=modes, driven=driven, first=tuple(first[:3]), rss_kib=rss_kib)


def _of(error: BaseException | None) -> str:
    return "" if error is None else f": {error!r}"


def stretches(steps: int, *, seed: int, processes: int) -> Iterator[Stretch]:
    """All of them, in order."""
    lengths = [min(STRETCH, steps - start) for start in range(0, steps, STRETCH)]
    yield from spread(partial(_stretch, seed=seed), enumerate(lengths), processes)


def _stretch(item: tuple[int, int], *, seed: int) -> Stretch:
    number, periods = item
    return stretch(number, seed=seed, periods=periods)


def main(
    steps: Annotated[int, typer.Option("--steps", min=1, help="Control periods in all.")] = 1_000_000,
    seed: Annotated[int, typer.Option("--seed", help="Of all that happens.")] = 0,
    processes: Processes = 2,
    json_file: JsonFile = None,
) -> None:
    """Run an ECU and a vehicle against a hostile bus, clock and controller, and judge every period from outside."""
    total = -(-steps // STRETCH)
    found = list(
        track(
            stretches(steps, seed=seed, processes=processes), "hostile", f"stretches of {STRETCH} periods", total=total
        )
    )
    figures = summed(found)
    console.print(_table(figures))
    for line in figures["first_violations"]:
        console.print(line)
    save(
        json_file,
        figures=figures,
        facts={"seed": seed, "settings": list(SETTINGS), "versions": versions("cantools", "autosar-e2e", "numpy")},
    )
    if figures["violations"]:
        raise typer.Exit(1)


def summed(found: list[Stretch]) -> dict[str, Any]:
    """The figures of all stretches together; memory is compared after a tenth of them, when caches are filled."""
    broken, modes = Counter[str](), Counter[str]()
    for one in found:
        broken += one.broken
        modes += one.modes
    tenth = len(found) // 10
    return {
        "steps": sum(one.periods for one in found),
        "violations": sum(broken.values()),
        "exceptions": broken["exceptions"],
        "broken": {name: broken[name] for name in PROMISES},
        "modes": {name: modes[name] for name in wire.MODES},
        "jets_driven": sum(one.driven for one in found),
        "memory_first_kib": max(one.rss_kib for one in found[: tenth + 1]),
        "memory_last_kib": max(one.rss_kib for one in found),
        "first_violations": [line for one in found for line in one.first][:10],
    }


def _table(figures: dict[str, Any]) -> Table:
    table = Table("promise", "what", "broken", box=None, pad_edge=False)
    for name, text in PROMISES.items():
        table.add_row(name, text, str(figures["broken"][name]))
    table.caption = (
        f"{figures['steps']} periods, the jets ran in {figures['jets_driven']}; memory "
        f"{figures['memory_first_kib']} KiB after a tenth, {figures['memory_last_kib']} KiB at the end"
    )
    return table
