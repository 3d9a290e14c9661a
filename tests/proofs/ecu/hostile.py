"""An ECU and a vehicle against a hostile bus, clock and controller, by chance, a million control periods long.

Whether a promise is kept is judged from outside, see `promises`. The same seed and number of steps give the same
periods on one process as on many.
"""

from collections import Counter
from functools import partial
from typing import Annotated, Any, Final, NamedTuple

import typer

from contract.config.tree import Config
from contract.config.vehicle import EcuConfig
from tests.proofs.command_line import JsonFile, Processes, Seed, in_parts, max_rss_kib, report
from tests.proofs.ecu.hostile_world import RandomEvents, World
from tests.proofs.ecu.promises import MODES, PROMISES

SETTINGS: Final = {
    "as they are": EcuConfig(),
    "not planning ahead": EcuConfig(plan_ahead=False),
    "an actuator two periods late": EcuConfig(delay_steps=2),
    "patient": EcuConfig(hold_periods=3, decay_periods=3, loss_limit=50, deadline_misses=11, rearm_frames=1),
    "impatient": EcuConfig(hold_periods=0, decay_periods=0, loss_window=10, loss_limit=2, pressure_age=1.0),
}
STRETCH: Final = 5_000  # periods in which one pair of nodes lives; each stretch has a seed of its own


class Stretch(NamedTuple):
    periods: int
    broken: Counter[str]  # how often each promise was
    modes: Counter[str]  # the ECU's steps in each
    driven: int  # periods in which the jets ran
    first: list[str]  # violations in words
    rss_kib: int  # of the process so far, at most


def stretch(part: range, *, seed: int) -> Stretch:
    """Live through one; its number chooses settings and, with `seed`, what happens."""
    number = part.start // STRETCH
    name = list(SETTINGS)[number % len(SETTINGS)]
    world, events = World(Config(ecu=SETTINGS[name])), RandomEvents(f"{seed} {number}")
    broken, modes, first, driven = Counter[str](), Counter[str](), list[str](), 0
    for _ in part:
        names, seen = world.period(events.next(world.now_ns)), world.seen
        driven += seen.action != 0.0
        if seen.answers:
            modes[world.ecu.trace.mode.name] += 1
        if names:
            broken.update(names)
            error = "" if seen.error is None else f": {seen.error!r}"
            first.append(f"stretch {number} ({name}), period {seen.period}: {', '.join(names)}{error}")
    return Stretch(len(part), broken, modes, driven, first[:3], max_rss_kib())


def main(
    steps: Annotated[int, typer.Option("--steps", min=1, help="Control periods in all.")] = 1_000_000,
    seed: Seed = 0,
    processes: Processes = 2,
    json_file: JsonFile = None,
) -> None:
    """Run an ECU and a vehicle against a hostile bus, clock and controller, and judge every period from outside."""
    figures = summed(list(in_parts(partial(stretch, seed=seed), steps, STRETCH, processes, "hostile")))
    packages = ("cantools", "autosar-e2e", "numpy")
    report(json_file, "hostile", figures, packages=packages, seed=seed, settings=list(SETTINGS))
    if figures["violations"]:
        raise typer.Exit(1)


def summed(parts: list[Stretch]) -> dict[str, Any]:
    """The figures of all stretches together; memory is compared after a tenth of them, when caches are filled."""
    broken, modes = (sum((getattr(one, name) for one in parts), Counter[str]()) for name in ("broken", "modes"))
    return {
        "steps": sum(one.periods for one in parts),
        "violations": broken.total(),
        "exceptions": broken["exceptions"],
        "broken": {name: broken[name] for name in PROMISES},
        "modes": {name: modes[name] for name in MODES},
        "jets_driven": sum(one.driven for one in parts),
        "memory_first_kib": max(one.rss_kib for one in parts[: len(parts) // 10 + 1]),
        "memory_last_kib": max(one.rss_kib for one in parts),
        "first_violations": [line for one in parts for line in one.first][:10],
    }
