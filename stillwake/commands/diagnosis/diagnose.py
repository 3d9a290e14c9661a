"""The command `stillwake diagnose`, which shows an ECU's report and its stored faults."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Final

import typer
from rich.box import SIMPLE_HEAD
from rich.table import Table

from contract.config.tree import Config
from contract.errors import ConfigError
from stillwake.commands.diagnosis import asking
from stillwake.console import options as shared
from stillwake.console.outputs import check_json, save_json
from stillwake.console.settings import TESTERS_BUS, settings, with_bus
from stillwake.console.terminal import console, print_table, visible

if TYPE_CHECKING:
    from can_bridge.flashing.report import StoreReport
    from can_bridge.tester.facts import StoredFault

_FACTS: Final = {
    "serial_number": "serial number",
    "hardware": "hardware",
    "software_version": "stillwake",
    "dbc_sha256": "DBC",
    "root_key": "root key",
    "period_ns": "control period",
    "capacity": "greatest image, bytes",
}
"""Labels for the values that are shown from an ECU's report, by the values' names in JSON."""


def diagnose(
    bus: shared.Bus = None,
    slots: shared.Slots = None,
    clear: Annotated[bool, typer.Option("--clear", help="Clear the shown faults.")] = False,
    json_file: shared.JsonFile = None,
    given: shared.Settings = [],  # noqa: B006
) -> None:
    """Show an ECU's report: its identification, its releases, and the faults that it found and stored.

    For each fault the command shows the time at which the ECU found it. The ECU stores a fault in non-volatile memory.
    The fault is removed when it is cleared, or when it has not occurred in 40 successive drives with control; its age
    is the number of successive drives in which it has not occurred. Faults can be cleared only while the jets are shut.
    With --slots the command reads an ECU's folder instead of a bus, and shows no faults.

    Exit status: 3 if the ECU does not answer; 5 if the faults are not cleared because the jets are enabled; 7 if the
    ECU refused something else.

    stillwake diagnose --bus socketcan:can0
    """
    check_json(json_file)
    config = settings("diagnose", with_bus(bus, given), uses=TESTERS_BUS).config
    if slots is not None:
        if bus is not None or clear:
            raise ConfigError("--slots reads a folder, not an ECU; leave out --bus and --clear")
        facts, store = _from_folder(slots)
        _print_ecu(facts, store, runs="not in the folder; to ask the ECU, use --bus instead of --slots")
        found: list[StoredFault] = []
    else:
        facts, store, found = _asked(config, clear=clear)
        _print_ecu(facts, store)
        console.print(_table(found) if found else "no faults")
        if clear:
            console.print("the ECU's faults are cleared")
    from can_bridge.flashing.report import tree

    figures = {**facts, "store": tree(store), "faults": [_figures(one) for one in found]}
    save_json(json_file, figures=figures, facts={"cleared": clear}, packages=("stillwake",))


def _print_ecu(facts: "dict[str, str | int]", store: "StoreReport", **rows: str) -> None:
    shown = {_FACTS[name]: str(value) for name, value in facts.items() if name != "period_ns"}
    if "period_ns" in facts:
        shown[_FACTS["period_ns"]] = f"{int(facts['period_ns']) / 1e6:g} ms"
    shown |= dict(_rows(store)) | rows
    print_table(rows=((name, visible(value)) for name, value in shown.items()), show_header=False)


def _asked(config: Config, *, clear: bool) -> "tuple[dict[str, str | int], StoreReport, list[StoredFault]]":
    """Return the report of the ECU on a bus. With `clear`, clear the ECU's faults after the report is read."""
    from can_bridge.tester.facts import read_facts, read_faults

    with asking(config.bus) as ecu:
        facts, found = read_facts(ecu), read_faults(ecu)
        if clear:
            ecu.clear_faults()
    names = ("serial_number", "hardware", "software_version", "dbc_sha256", "period_ns", "capacity")
    return {name: getattr(facts, name) for name in names}, facts.store, found


def _from_folder(slots: Path) -> "tuple[dict[str, str | int], StoreReport]":
    """Read the contents of an ECU's folder; nothing is booted and nothing is written."""
    from can_bridge.flashing import report
    from can_bridge.flashing.folder_backing import FolderBacking
    from can_bridge.flashing.store import Store
    from can_bridge.flashing.verdicts import Verdict
    from ecu.flashable.ecu_folder import read_folder

    folder = read_folder(slots)
    backing, fits = FolderBacking(slots), lambda bundle: Verdict.WRONG_VEHICLE
    store = Store(backing, root=folder.root, hardware=folder.hardware, fits=fits)
    found: dict[str, str | int] = {"serial_number": folder.serial, "hardware": folder.hardware}
    found |= {"root_key": folder.root.fingerprint, "capacity": store.backing.capacity}
    return found, report.decode(report.encode(store))


def _rows(report: "StoreReport") -> list[tuple[str, str]]:
    from can_bridge.flashing.backing import Slot

    rows = []
    for slot, standing in zip(Slot, report.slots, strict=True):
        words = [standing.phase.name.lower()]
        if standing.name:
            words.append(f"{standing.name} {standing.digest[:12]}, security version {standing.security_version}")
        if standing.received < standing.length:
            words.append(f"{standing.received} of {standing.length} bytes")
        if standing.boots_left:
            words.append(f"{standing.boots_left} boots left")
        if standing.verdict:
            words.append(standing.verdict.in_words)
        rows.append((f"slot {slot.name}", ", ".join(words)))
    names = {"runs": report.running, "boots next": report.next_boot}
    rows += [(name, "none" if slot is None else f"slot {slot.name}") for name, slot in names.items()]
    if report.reason is not None:
        rows.append(("at its last boot", report.reason.in_words))
    keys = "none" if report.key_list_version is None else f"version {report.key_list_version}"
    attempts = ", ".join(f"{level.name.lower()} {count}" for level, count in report.failed_attempts.items())
    rows += [("least security version", str(report.least_security_version)), ("key list", keys)]
    return [*rows, ("wrong keys in a row", attempts)]


def _table(found: "list[StoredFault]") -> Table:
    from can_bridge.uds.fault_memory import in_letters
    from firmware_sim.runs.reasons import BECAUSE

    heads = ("code", "found when", "state", "at", "mode before", "missed", "overruns", "pressures, Cp")
    made = Table(*heads, box=SIMPLE_HEAD, padding=0)
    for one in found:
        moment = ["", "", "", "", ""]
        if one.time_ms is not None and one.mode_before is not None and one.pressures_cp is not None:
            pressures = " ".join(f"{cp:.3f}" for cp in one.pressures_cp)
            at = f"{one.time_ms / 1000:.1f} s"
            moment = [at, one.mode_before.name, str(one.missed), str(one.overruns), pressures]
        made.add_row(in_letters(one.code), BECAUSE[one.reason], _state(one), *moment)
    return made


def _state(one: "StoredFault") -> str:
    from can_bridge.uds.fault_memory import Status

    if one.status & Status.TEST_FAILED:
        return "present"
    return "pending" if one.status & Status.PENDING else f"stored, age {one.age}"


def _figures(one: "StoredFault") -> dict[str, Any]:
    from can_bridge.uds.fault_memory import in_letters

    mode = None if one.mode_before is None else one.mode_before.name
    return {**vars(one), "code": in_letters(one.code), "reason": one.reason.name, "mode_before": mode}
