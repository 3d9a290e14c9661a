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


class PageTable(NamedTuple):
    """A table of the pages: the function that returns it, and the names of the results files that this function takes.
    The last field names the file whose date, version and release are stated below the table, usually the file with most
    rows. The field is empty if the table itself states them."""

    made: Callable[..., str]
    files: tuple[str, ...]
    origin: str = ""


TABLES: Final = {
    "authentication": PageTable(bus.authentication, ("bus", "bus_studies"), "bus_studies"),
    "bounds": PageTable(controller.bounds, ("bounds",)),
    "bundle_fuzz": PageTable(release.bundle_fuzz, ("bundle_fuzz",)),
    "bus": PageTable(bus.bus, ("bus", "bus_studies")),
    "bus_faults": PageTable(bus.bus_faults, tuple(bus.FAULTED.values()), "bus_loss_05"),
    "bus_runs": PageTable(bus.bus_runs, tuple(bus.RUNS.values()), "bus_secured"),
    "campaign": PageTable(release.campaign, ("campaign",)),
    "can_load": PageTable(bus.can_load, tuple(bus.CAN_LOADS), "can_load_fd"),
    "controller": PageTable(controller.latency, ("controller",), "controller"),
    "demo": PageTable(release.demo, ("demo",)),
    "drive": PageTable(release.drive, ("drive",)),
    "ecu_c": PageTable(ecu.twin, ("ecu_c",)),
    "ecu_loop": PageTable(ecu.loops, ("ecu_loop",)),
    "flash_c": PageTable(ecu.flash_c, ("flash_c",), "flash_c"),
    "flash_pieces": PageTable(ecu.flash_pieces, ("flash_pieces",)),
    "flash_proof": PageTable(ecu.flash_proof, ("flash",)),
    "iterations": PageTable(release.iterations, ("iterations",)),
    "latency": PageTable(bus.latency, ("latency",)),
    "limits": PageTable(
        release.limits, ("demo", "limit_late_start", "limit_latency", "limit_iterations"), "limit_latency"
    ),
    "mcu": PageTable(controller.mcu, ("mcu",)),
    "mcu_release": PageTable(controller.mcu_release, ("mcu",), "mcu"),
    "mcu_worst": PageTable(controller.mcu_worst, ("mcu",)),
    "models": PageTable(ecu.models, ("models",)),
    "openfoam_drive": PageTable(release.openfoam_drive, ("own_drive", "openfoam_drive"), "openfoam_drive"),
    "openfoam_loop": PageTable(release.openfoam_loop, ("demo", "openfoam_loop")),
    "proofs": PageTable(ecu.proofs, ("proofs",)),
    "release_distributions": PageTable(release.release_distributions, ("release_figures",), "release_figures"),
    "release_forecasts": PageTable(release.release_forecasts, ("release_figures",)),
    "release_loop": PageTable(release.release_loop, ("release_loop",)),
    "roads": PageTable(release.roads, ("roads", "release_loop"), "roads"),
    "runtimes": PageTable(controller.runtimes, ("runtimes",), "runtimes"),
    "sensor_check_alarms": PageTable(ecu.alarms, ("sensor_check",), "sensor_check"),
    "sensor_check_faults": PageTable(ecu.faults, ("sensor_check",), "sensor_check"),
    "square_loop": PageTable(release.release_loop, ("square_loop",)),
    "steady": PageTable(release.steady, ("steady", "demo")),
    "steps": PageTable(controller.steps, ("wake_speed",), "wake_speed"),
    "summary": PageTable(
        release.summary, ("demo", "openfoam_loop", "open_loop", "release_loop", "roads", "drive"), "demo"
    ),
    "uds_states": PageTable(ecu.uds_states, ("uds_states",)),
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
