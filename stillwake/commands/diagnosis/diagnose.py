"""`stillwake diagnose`: the faults that an ECU remembers, and the description of its diagnosis for other testers."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from rich.box import SIMPLE_HEAD
from rich.table import Table

from contract.atomic import replacing
from contract.results import versions
from stillwake.console.bus_option import BusName, with_bus
from stillwake.console.claims import claim
from stillwake.console.outputs import check_json, save_json
from stillwake.console.settings import TESTERS_BUS, settings
from stillwake.console.terminal import ConfigFile, JsonFile, Overrides, console
from stillwake.parts.conversation import asking
from stillwake.parts.descriptions import pdx_of

if TYPE_CHECKING:
    from can_bridge.tester.faults import StoredFault

diagnose = typer.Typer(no_args_is_help=True, help="An ECU's faults, and its diagnosis for other testers.")


@diagnose.command()
def faults(
    bus: BusName = None,
    clear: Annotated[bool, typer.Option("--clear", help="Then have the ECU forget them.")] = False,
    json_file: JsonFile = None,
    config_file: ConfigFile = None,
    overrides: Overrides = [],  # noqa: B006
) -> None:
    """Show the faults that an ECU found and remembers, each with the moment in which it was found.

    Faults are kept over a loss of power, until they are cleared, or until 40 drives with control were without them: an
    age of so many. They are cleared while the jets are shut.

    Exit status: 3 no answer from the ECU; 5 not cleared, the jets are enabled; 7 the ECU refused something else.

    stillwake diagnose faults --bus socketcan:can0
    """
    from can_bridge.tester import faults as remembered

    check_json(json_file)
    config = settings("diagnose faults", config_file, with_bus(bus, overrides), uses=TESTERS_BUS).config
    with asking(config.bus) as ecu:
        found = remembered.read(ecu)
        if clear:
            remembered.clear(ecu)
    console.print(_table(found) if found else "no faults")
    if clear:
        console.print("the ECU's faults are cleared")
    facts = {"cleared": clear, "versions": versions("stillwake")}
    save_json(json_file, figures=[_figures(one) for one in found], facts=facts)


@diagnose.command()
def pdx(
    output: Annotated[Path, typer.Argument(metavar="FILE.pdx", help="Where to write; replaced if it is there.")],
    config_file: ConfigFile = None,
    overrides: Overrides = [],  # noqa: B006
) -> None:
    """Write the description of the ECU's diagnosis as a PDX file (ODX, ISO 22901-1), for other testers; needs no ECU.

    It has every service, identifier, routine, trouble code and negative response, the sessions and levels that they
    need, and how the ECU is reached on a bus with these settings.

    stillwake diagnose pdx stillwake.pdx
    """
    claim(output)
    config = settings("diagnose pdx", config_file, overrides, uses=TESTERS_BUS).config
    with replacing(output) as part:
        part.write_bytes(pdx_of(config))
    console.print(f"wrote {output}: the diagnosis of an ECU on {config.bus.frames} frames")


def _table(found: "list[StoredFault]") -> Table:
    from can_bridge.uds.fault_codes import in_letters
    from firmware_sim.runs.reasons import BECAUSE

    made = Table(box=SIMPLE_HEAD, padding=0)
    for head in ("code", "found when", "state", "at", "mode before", "missed", "overruns", "pressures, Cp"):
        made.add_column(head)
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
    from can_bridge.uds.fault_codes import in_letters

    mode = None if one.mode_before is None else one.mode_before.name
    return {**vars(one), "code": in_letters(one.code), "reason": one.reason.name, "mode_before": mode}
