"""Fill every table of README.md and `docs/` from `results/*.json`; `make tables` runs this module after results have
changed.

On a page, a table is written between `<!-- table NAME -->` and `<!-- end -->`; the functions `tables` of the folders
return the tables by these names. Pages are found by these marks, so a table can move to another page without a change
here.
"""

from pathlib import Path

from benchmarks.bus import flash_tables, latency_tables, load_tables
from benchmarks.bus import tables as bus_tables
from benchmarks.common.commands import ROOT
from benchmarks.common.markdown import fill, names, read
from benchmarks.controller import tables as controller_tables
from benchmarks.ecu import tables as ecu_tables
from benchmarks.release import campaign_tables, loop_tables, roads_tables
from benchmarks.release import tables as release_tables
from benchmarks.wake import tables as wake_tables
from contract.atomic import replacing

FOLDERS = (
    bus_tables,
    ecu_tables,
    flash_tables,
    latency_tables,
    release_tables,
    campaign_tables,
    loop_tables,
    wake_tables,
    controller_tables,
    load_tables,
    roads_tables,
)

SOURCES = {
    "authentication": "bus", "bus_faults": "bus_loss_05", "bus_runs": "bus_secured",
    "can_load": "can_load_fd", "controller": "controller",
    "controller_loop": "controller_loop", "flash_c": "flash_c", "limits": "limit_latency",
    "mcu_release": "mcu", "release_distributions": "release_figures",
    "roads": "roads", "runtimes": "runtimes", "sensor_check_alarms": "sensor_check",
    "sensor_check_faults": "sensor_check", "steps": "wake_speed", "summary": "demo",
}  # fmt: skip
"""Results file whose date, version and release are stated below a table, by the table's name. If a table is made from
several files, this is the file of most of its rows."""


def tables(results: Path) -> dict[str, str]:
    """Return the text of each table, by the table's name in the pages. Raises ValueError if two folders have a table of
    the same name."""
    made: dict[str, str] = {}
    for folder in FOLDERS:
        of_folder = folder.tables(results)
        if twice := sorted(made.keys() & of_folder.keys()):
            raise ValueError(f"{folder.__name__}: the table {twice[0]!r} is another folder's: rename one of them")
        made |= of_folder
    return made | {
        name: f"{made[name].rstrip()}\n\n{_origin(results / f'{file}.json')}" for name, file in SOURCES.items()
    }


def _origin(path: Path) -> str:
    """Return a sentence with the date, version and release of a table's measurement; facts that its results file lacks
    are left out."""
    found = read(path)
    facts = found["facts"]
    bundle = facts.get("bundle_name") or facts.get("bundle") or facts.get("controller") or ""
    release = str(bundle["name"] if isinstance(bundle, dict) else bundle).partition(" (")[0]
    version = facts.get("versions", {}).get("stillwake")
    parts = (f"Measured on {found['date']}", version and f"with {version}", "-" in release and f"release {release}")
    return f"*{', '.join(part for part in parts if part)}.*"


def pages() -> list[Path]:
    """Return every page that contains a table."""
    return [page for page in (ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md"))) if names(_read(page))]


def filled(page: Path, made: dict[str, str]) -> str:
    """Return the page with its tables replaced by those in `made`."""
    return fill(_read(page), made)


def main() -> None:
    """Write all pages that contain tables."""
    made = tables(ROOT / "results")
    for page in pages():
        text = filled(page, made)
        with replacing(page) as temporary:
            temporary.write_text(text, encoding="utf-8")


def _read(page: Path) -> str:
    return page.read_text(encoding="utf-8")
