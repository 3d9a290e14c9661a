"""Fill every table of README.md and `docs/` from `results/*.json`; `make tables` runs this module after results have
changed.

On a page, a table is written between `<!-- table NAME -->` and `<!-- end -->`, where NAME is a name in `TABLES`. Pages
are found by these marks, so a table can move to another page without a change here.
"""

from collections.abc import Callable
from pathlib import Path
from typing import Final, NamedTuple

from benchmarks.bus import tables as bus
from benchmarks.common.command_line import ROOT
from benchmarks.common.documents import fill, names, read
from benchmarks.controller import tables as controller
from benchmarks.ecu import tables as ecu
from benchmarks.release import tables as release
from contract.atomic import replacing


class Table(NamedTuple):
    """A table of the pages: the function that returns it, the names of the results files that this function takes, and
    the name of the file whose date, version and release are stated below the table; "" if the table states them."""

    made: Callable[..., str]
    files: tuple[str, ...]
    origin: str = ""


TABLES: Final = {
    "authentication": Table(bus.authentication, ("bus", "bus_studies"), "bus_studies"),
    "bounds": Table(controller.bounds, ("bounds",)),
    "bundle_fuzz": Table(release.bundle_fuzz, ("bundle_fuzz",)),
    "bus": Table(bus.bus, ("bus", "bus_studies")),
    "bus_faults": Table(bus.bus_faults, tuple(bus.FAULTED.values()), "bus_loss_05"),
    "bus_runs": Table(bus.bus_runs, tuple(bus.RUNS.values()), "bus_secured"),
    "campaign": Table(release.campaign, ("campaign",)),
    "can_load": Table(bus.can_load, tuple(bus.CAN_LOADS), "can_load_fd"),
    "controller": Table(controller.latency, ("controller",), "controller"),
    "demo": Table(release.demo, ("demo",)),
    "drive": Table(release.drive, ("drive",)),
    "ecu_c": Table(ecu.twin, ("ecu_c",)),
    "ecu_loop": Table(ecu.loops, ("ecu_loop",)),
    "flash_c": Table(ecu.flash_c, ("flash_c",), "flash_c"),
    "flash_pieces": Table(ecu.flash_pieces, ("flash_pieces",)),
    "flash_proof": Table(ecu.flash_proof, ("flash",)),
    "iterations": Table(release.iterations, ("iterations",)),
    "latency": Table(bus.latency, ("latency",)),
    "limits": Table(release.limits, ("demo", "limit_late_start", "limit_latency", "limit_iterations"), "limit_latency"),
    "mcu": Table(controller.mcu, ("mcu",)),
    "mcu_release": Table(controller.mcu_release, ("mcu",), "mcu"),
    "mcu_worst": Table(controller.mcu_worst, ("mcu",)),
    "models": Table(ecu.models, ("models",)),
    "openfoam_drive": Table(release.openfoam_drive, ("own_drive", "openfoam_drive"), "openfoam_drive"),
    "openfoam_loop": Table(release.openfoam_loop, ("demo", "openfoam_loop")),
    "proofs": Table(ecu.proofs, ("proofs",)),
    "release_distributions": Table(release.release_distributions, ("release_figures",), "release_figures"),
    "release_forecasts": Table(release.release_forecasts, ("release_figures",)),
    "release_loop": Table(release.release_loop, ("release_loop",)),
    "roads": Table(release.roads, ("roads", "release_loop"), "roads"),
    "runtimes": Table(controller.runtimes, ("runtimes",), "runtimes"),
    "sensor_check_alarms": Table(ecu.alarms, ("sensor_check",), "sensor_check"),
    "sensor_check_faults": Table(ecu.faults, ("sensor_check",), "sensor_check"),
    "square_loop": Table(release.release_loop, ("square_loop",)),
    "steady": Table(release.steady, ("steady", "demo")),
    "steps": Table(controller.steps, ("wake_speed",), "wake_speed"),
    "summary": Table(release.summary, ("demo", "openfoam_loop", "open_loop", "release_loop", "roads", "drive"), "demo"),
    "uds_states": Table(ecu.uds_states, ("uds_states",)),
}
"""All tables by their names in the pages."""


def tables(results: Path) -> dict[str, str]:
    """Return the text of each table, by the table's name in the pages."""
    made = {}
    for name, one in TABLES.items():
        made[name] = one.made(*(read(results / f"{file}.json") for file in one.files))
        if one.origin:
            made[name] = f"{made[name].rstrip()}\n\n{_origin(results / f'{one.origin}.json')}"
    return made


def _origin(path: Path) -> str:
    """Return a sentence with a measurement's date and, if they are known, its version and release."""
    found = read(path)
    facts = found["facts"]
    bundle = facts.get("bundle_name") or facts.get("bundle") or facts.get("controller") or ""
    release = str(bundle["name"] if isinstance(bundle, dict) else bundle).partition(" (")[0]
    version = facts.get("versions", {}).get("stillwake")
    parts = (f"Measured on {found['date']}", version and f"with {version}", "-" in release and f"release {release}")
    return f"*{', '.join(part for part in parts if part)}.*"


def pages() -> list[Path]:
    """Return every page that contains a table."""
    candidates = (ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md")))
    return [page for page in candidates if names(page.read_text(encoding="utf-8"))]


def main() -> None:
    """Write all pages that contain tables."""
    made = tables(ROOT / "results")
    for page in pages():
        text = fill(page.read_text(encoding="utf-8"), made)
        with replacing(page) as temporary:
            temporary.write_text(text, encoding="utf-8")
