"""`stillwake calibrate`: the goal and the limits of an ECU that runs, read and changed by diagnosis."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Final

import typer
from rich.box import SIMPLE_HEAD
from rich.table import Table
from rich.text import Text

from contract.atomic import replacing
from contract.config.tree import Config
from contract.controller.calibration import NAMES
from contract.errors import ConfigError
from contract.results import versions
from stillwake.console.bus_option import BusName, with_bus
from stillwake.console.claims import claim
from stillwake.console.outputs import check_json, save_json
from stillwake.console.settings import TESTERS_BUS, settings
from stillwake.console.terminal import ConfigFile, JsonFile, Overrides, console
from stillwake.parts.conversation import asking
from stillwake.parts.descriptions import a2l_of
from stillwake.parts.releases import Trust, open_release

if TYPE_CHECKING:
    from can_bridge.tester.calibration import Calibrated

_OF_THE_VEHICLE: Final = (
    *("operating_point", "flow.control_period", "flow.action_limit"),
    *("ecu.command_step", "ecu.delay_steps", "ecu.plan_ahead"),
)
"""Settings that limit a release's calibration, for the A2L file."""


def calibrate(
    values: Annotated[
        list[str] | None,
        typer.Argument(
            metavar="NAME=VALUE", help="What to change; without any, the values are shown.", show_default=False
        ),
    ] = None,
    bus: BusName = None,
    access: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Key of the ECU's security access; reading needs none.")
    ] = None,
    store: Annotated[bool, typer.Option("--store", help="Let the values outlive a loss of power.")] = False,
    revert: Annotated[bool, typer.Option("--revert", help="Back to the release's own values, also stored.")] = False,
    a2l: Annotated[
        Path | None,
        typer.Option("--a2l", metavar="FILE", help="Write the A2L file for a calibration tool; needs no ECU."),
    ] = None,
    bundle: Annotated[
        Path | None, typer.Option("--bundle", help="Release for the A2L file; default: the shipped one.")
    ] = None,
    trust: Trust = None,
    json_file: JsonFile = None,
    config_file: ConfigFile = None,
    overrides: Overrides = [],  # noqa: B006
) -> None:
    """Show and change the goal of the control and its limits, in an ECU that runs.

    New values act together, from the next control period on, and until the ECU loses power unless they are stored;
    stored ones go with the release that runs. Limits can be made narrower than the release's and the vehicle's, never
    wider.

    Exit status: 1 a value out of its limits, or no release runs; 3 no answer from the ECU; 4 the access key is wrong;
    5 not stored, the jets are enabled; 7 the ECU refused something else.

    stillwake calibrate --bus socketcan:can0 --access access.key lift=0.4 action_limit=0.05
    """
    check_json(json_file)
    changes = parsed(values or [])
    _check_options(changes, access=access, store=store, revert=revert, a2l=a2l, bundle=bundle, bus=bus)
    uses = (*TESTERS_BUS, *_OF_THE_VEHICLE) if a2l is not None else TESTERS_BUS
    config = settings("calibrate", config_file, with_bus(bus, overrides), uses=uses).config
    if a2l is not None:
        _write_a2l(a2l, bundle, trust, config)
        return
    from can_bridge.tester import calibration

    with asking(config.bus, access) as ecu:
        found = after = calibration.read(ecu)
        wanted = calibration.changed(found, changes) if changes else None
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
    console.print(after_power_on(after))
    facts = {"changed": changes, "store": store, "revert": revert, "versions": versions("stillwake")}
    save_json(json_file, figures=figures(found, after), facts=facts)


def parsed(texts: Sequence[str]) -> dict[str, float]:
    """Values by name; raises ConfigError for what is none, or a name that comes twice."""
    changes: dict[str, float] = {}
    for text in texts:
        name, equals, value = text.partition("=")
        if name not in NAMES or not equals:
            raise ConfigError(f"{text!r}: must be NAME=VALUE with a name of {', '.join(NAMES)}")
        if name in changes:
            raise ConfigError(f"{text!r}: {name} is given twice")
        try:
            changes[name] = float(value)
        except ValueError:
            raise ConfigError(f"{text!r}: {value!r} must be a number") from None
    return changes


def table(before: "Calibrated", after: "Calibrated") -> Table:
    """Values, what they were if they changed, limits, and the release's own."""
    is_changed = before.in_force != after.in_force
    heads = ("value", *(("before", "after") if is_changed else ("in force",)), "least", "greatest", "release's")
    made = Table(box=SIMPLE_HEAD, padding=0)
    for head in heads:
        made.add_column(head, justify="left" if head == "value" else "right")
    rows = (before.in_force, after.in_force, after.limits.least, after.limits.greatest, after.release)
    for name, was, now, *others in zip(NAMES, *(one.values for one in rows), strict=True):
        cells = [f"{was:.6g}", f"{now:.6g}"] if is_changed else [f"{now:.6g}"]
        made.add_row(name, *cells, *(f"{value:.6g}" for value in others), style="bold" if was != now else None)
    return made


def after_power_on(after: "Calibrated") -> Text:
    """What becomes of the values at power-on, in words."""
    if after.is_stored:
        return Text("a calibration is stored: it is in force after the next power-on, as long as this release runs")
    return Text("nothing is stored: after the next power-on the release's own values are in force")


def figures(before: "Calibrated", after: "Calibrated") -> dict[str, Any]:
    """All values by name."""
    shown = {"before": before.in_force, "after": after.in_force, "release": after.release}
    shown |= {"least": after.limits.least, "greatest": after.limits.greatest}
    values = {name: dict(zip(NAMES, one.values, strict=True)) for name, one in shown.items()}
    return {**values, "stored": after.is_stored}


def _check_options(changes: Mapping[str, float], *, store: bool, revert: bool, **places: object) -> None:
    """Raises ConfigError for options that contradict each other or lack one."""
    if places["a2l"] is not None:
        given = bool(changes) or store or revert or places["bus"] is not None or places["access"] is not None
        if given:
            raise ConfigError("--a2l: writes a file and asks no ECU; leave values, --bus, --access and the others out")
        return
    if places["bundle"] is not None:
        raise ConfigError("--bundle: goes with --a2l; an ECU is calibrated by what it reports of itself")
    if revert and (store or changes):
        raise ConfigError("--revert: drops what is in force and stored; leave values and --store out")
    if (changes or store or revert) and places["access"] is None:
        raise ConfigError("--access: name the file of the ECU's access key; only reading does without")


def _write_a2l(path: Path, bundle: Path | None, trust: str | None, config: Config) -> None:
    """The A2L file of a release in a vehicle with these settings."""
    claim(path)
    release = open_release(bundle, trust)
    content = a2l_of(release, config)
    with replacing(path) as part:
        part.write_bytes(content)
    console.print(f"wrote {path}: the calibration of {release.manifest.name}")
