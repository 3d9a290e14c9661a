"""The command `stillwake calibrate`, which reads and changes the goal and the limits of a running ECU over UDS."""

from typing import TYPE_CHECKING, Annotated, Any

import typer
from rich.box import SIMPLE_HEAD
from rich.table import Column, Table

from contract.controller.calibration import CALIBRATION_NAMES
from contract.errors import ConfigError
from stillwake.commands.diagnosis import asking
from stillwake.console import options as shared
from stillwake.console.outputs import check_json, save_json
from stillwake.console.settings import TESTERS_BUS, settings, with_bus
from stillwake.console.terminal import console

if TYPE_CHECKING:
    from can_bridge.tester.calibration import Calibrated

Values = Annotated[list[str] | None, typer.Argument(metavar="NAME=VALUE", help="Values to change.", show_default=False)]
Store = Annotated[bool, typer.Option("--store", help="Store the values, so that they survive a loss of power.")]
Revert = Annotated[bool, typer.Option("--revert", help="Return to the release's values; stored values are deleted.")]


def calibrate(
    values: Values = None,
    bus: shared.Bus = None,
    access: shared.Access = None,
    store: Store = False,
    revert: Revert = False,
    json_file: shared.JsonFile = None,
    given: shared.Settings = [],  # noqa: B006
) -> None:
    """Show and change the goal of the control and its limits in a running ECU.

    New values take effect together in the next control period. They are lost when the ECU loses power, unless --store
    stores them; stored values apply to the running release only. A limit can be narrower than the release's limit and
    the vehicle's limit, never wider. Reading needs no --access. A calibration tool can use the A2L file that `export
    --for-testers` writes.

    Exit status: 1 if a value is out of its limits, or no release runs; 3 if the ECU does not answer; 4 if the access
    key is wrong; 5 if the values are not stored because the jets are enabled; 7 if the ECU refused something else.

    stillwake calibrate --bus socketcan:can0 --access access.key lift=0.4 action_limit=0.05
    """
    check_json(json_file)
    changes = parsed(values or [])
    if revert and (store or changes):
        raise ConfigError("--revert discards present and stored values; leave out new values and --store")
    if (changes or store or revert) and access is None:
        raise ConfigError("--access: name the file of the ECU's access key; only reading needs no key")
    config = settings("calibrate", with_bus(bus, given), uses=TESTERS_BUS).config
    from can_bridge.tester import calibration

    with asking(config.bus, access) as ecu:
        found = after = calibration.read(ecu)
        wanted = found.limits.changed(found.in_force, changes) if changes else None
        if wanted is not None or store or revert:
            calibration.unlock(ecu)
            if revert:
                calibration.revert(ecu, found.release)
            if wanted is not None:
                calibration.write(ecu, wanted)
            if store:
                calibration.store(ecu)
            after = calibration.read(ecu)
    console.print(table(found, after))
    if after.is_stored:
        console.print("a calibration is stored: it is in force after the next power-on, as long as this release runs")
    else:
        console.print("nothing is stored: after the next power-on the release's own values are in force")
    facts = {"changed": changes, "store": store, "revert": revert}
    save_json(json_file, figures=figures(found, after), facts=facts, packages=("stillwake",))


def parsed(texts: list[str]) -> dict[str, float]:
    """Read the values to set, by name. Raises ConfigError for a text other than NAME=NUMBER, or a repeated name."""
    changes: dict[str, float] = {}
    for name, value in shared.pairs(texts, "lift=0.4", CALIBRATION_NAMES):
        try:
            changes[name] = float(value)
        except ValueError:
            raise ConfigError(f"{name}={value}: {value!r} must be a number") from None
    return changes


def table(before: "Calibrated", after: "Calibrated") -> Table:
    """Return a table of the values, the previous values if they changed, the limits, and the release's own values."""
    is_changed = before.in_force != after.in_force
    heads = ("value", *(("before", "after") if is_changed else ("in force",)), "least", "greatest", "release's")
    columns = (Column(head, justify="left" if head == "value" else "right") for head in heads)
    made = Table(*columns, box=SIMPLE_HEAD, padding=0)
    rows = (before.in_force, after.in_force, after.limits.least, after.limits.greatest, after.release)
    for name, was, now, *others in zip(CALIBRATION_NAMES, *(one.values for one in rows), strict=True):
        cells = [f"{was:.6g}", f"{now:.6g}"] if is_changed else [f"{now:.6g}"]
        made.add_row(name, *cells, *(f"{value:.6g}" for value in others), style="bold" if was != now else None)
    return made


def figures(before: "Calibrated", after: "Calibrated") -> dict[str, Any]:
    """Return the values before and after the change, the release's values, and the limits, by name."""
    shown = {"before": before.in_force, "after": after.in_force, "release": after.release}
    shown |= {"least": after.limits.least, "greatest": after.limits.greatest}
    values = {name: dict(zip(CALIBRATION_NAMES, one.values, strict=True)) for name, one in shown.items()}
    return {**values, "stored": after.is_stored}
