"""`stillwake flash`: a release into an ECU, over its CAN bus."""

import time
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from rich.progress import Progress, TaskID
from rich.table import Table

from contract.errors import ConfigError
from contract.release.checks import Bundle
from stillwake.console.bus_option import BusName, with_bus
from stillwake.console.progress import span
from stillwake.console.settings import TESTERS_BUS, settings
from stillwake.console.stopping import go_on_with
from stillwake.console.terminal import ConfigFile, Overrides, console, progress_bar
from stillwake.parts.releases import Trust, describe, open_release

if TYPE_CHECKING:
    from can_bridge.tester.facts import EcuFacts
    from can_bridge.tester.sequence import Flashed, Step


def flash(
    bundle: Annotated[Path, typer.Argument(help="Release bundle; or image (.swi) for an ECU in C.")],
    bus: BusName = None,
    access: Annotated[
        Path | None,
        typer.Option(help="The ECU's access key, a file as `can keygen` writes it.", metavar="KEYFILE"),
    ] = None,
    trust: Trust = None,
    dry_run: Annotated[
        bool, typer.Option("--dry-run", help="Ask the ECU, check everything, and write nothing.")
    ] = False,
    no_confirm: Annotated[
        bool, typer.Option("--no-confirm", help="Leave the release on trial: without a confirmation it is given up.")
    ] = False,
    config_file: ConfigFile = None,
    overrides: Overrides = [],  # noqa: B006
) -> None:
    """Bring a release into an ECU over UDS, start it on trial, test it, and confirm it.

    The jets must be shut and the vehicle must not ask for control. Whatever interrupts it, the ECU keeps the release
    that it has until the new one has passed its self-test, and the same command goes on where it stood. Where that
    release runs already, nothing is done.

    Exit status: 3 no answer from the ECU; 4 the access key is wrong; 5 not now, the vehicle is in use; 6 the release is
    not for this ECU, or the ECU refused it; 7 the ECU refused something else; 8 the new release did not start or pass
    its self-test, and the one before runs.

    stillwake flash firmware_sim/data/bundle --bus socketcan:can0 --access access.key
    """
    from can_bridge.tester.local_checks import check_fits
    from can_bridge.tester.sequence import End, Options
    from can_bridge.tester.sequence import flash as flash_ecu
    from can_bridge.tester.transport import open_client
    from can_bridge.uds.access_key import AccessKey
    from contract.release.container import read_files
    from contract.release.image import image_of
    from contract.release.image_contents import is_image, opened

    config = settings("flash", config_file, with_bus(bus, overrides), uses=TESTERS_BUS).config
    if access is None and not dry_run:
        raise ConfigError("--access: must name the ECU's key file; --dry-run alone does without")
    key = None if access is None else AccessKey.read(access)
    release = None if is_image(bundle) else open_release(bundle, trust)
    if release is None:
        # Whom it is signed by, and what it is for, is the ECU's to judge.
        name, image = opened(bundle).facts.name, bundle.read_bytes()
        console.print(f"image {name}, {len(image)} bytes")
    else:
        name, image = release.manifest.name, image_of(read_files(bundle))
        console.print(*describe(release), sep="\n")

    def judge(facts: "EcuFacts") -> None:
        console.print(f"ECU {facts.serial_number}, {facts.hardware}: runs {_running(facts)}")
        if release is not None:
            if dry_run:
                console.print(_comparison(release, len(image), facts))
            check_fits(release, len(image), facts)

    with (
        open_client(config.bus) as client,
        progress_bar("bytes") as bar,
        go_on_with("the ECU keeps what it has, and the same command goes on where it stood"),
    ):
        shown = _Shown(bar)
        flashed = flash_ecu(
            client,
            image,
            key=None if key is None else key.answer,
            options=Options(dry_run=dry_run, confirm=not no_confirm),
            judge=judge,
            progress=shown.progress,
            on_step=shown.on_step,
        )
    line = {
        End.ALREADY: f"{name} runs already, and is confirmed: nothing was done",
        End.WOULD_FLASH: "dry run: nothing stands against it, and nothing was written",
        End.ON_TRIAL: f"{name} runs on trial, {_boots_left(flashed)} boots left; the same command "
        "without --no-confirm confirms it",
        End.CONFIRMED: f"{name} runs, and is confirmed",
    }[flashed.end]
    console.print(line + _effort(flashed, len(image)))


class _Shown:
    """The transfer as a bar, with its rate or what comes after it as the note."""

    def __init__(self, bar: Progress) -> None:
        self._bar = bar
        self._task: TaskID | None = None
        self._began = self._from = 0.0

    def progress(self, received: int, length: int) -> None:
        now = time.monotonic()
        if self._task is None:
            self._task = self._bar.add_task("flash", total=length, completed=received)
            self._began, self._from = now, received
        elapsed = now - self._began
        note = f"{(received - self._from) / 1000.0 / elapsed:.0f} kB/s" if received > self._from and elapsed else ""
        self._bar.update(self._task, completed=received, note=note)

    def on_step(self, step: "Step") -> None:
        if self._task is not None:
            self._bar.update(self._task, note=step.name.lower().replace("_", " "))


def _running(facts: "EcuFacts") -> str:
    running = facts.store.running_slot
    if running is None:
        return "no release"
    how = "confirmed" if facts.store.active == facts.store.running else "not confirmed"
    return f"{running.name} {running.digest[:12]}, {how}"


def _boots_left(flashed: "Flashed") -> int:
    running = flashed.after.running_slot
    return 0 if running is None else running.boots_left


def _effort(flashed: "Flashed", length: int) -> str:
    if flashed.transferred is None:
        return ""
    sent = length - flashed.transferred.resumed_from
    again = f", {flashed.unanswered} requests sent again" if flashed.unanswered else ""
    return f"; {sent} bytes sent, {span(flashed.seconds)} in all{again}"


def _comparison(release: Bundle, length: int, facts: "EcuFacts") -> Table:
    """What would be flashed, next to what the ECU reports."""
    from can_bridge.flashing.backing import Slot
    from contract.release.checks import dbc_sha256

    manifest = release.manifest
    period_ms = manifest.operating_point.period_ns(manifest.control_period) / 1e6
    table = Table("", "bundle", "ECU")
    table.add_row("release", f"{manifest.name} {release.digest[:12]}", _running(facts))
    table.add_row("hardware", manifest.hardware or "any", facts.hardware)
    table.add_row("DBC", dbc_sha256()[:12], facts.dbc_sha256[:12])
    table.add_row("control period", f"{period_ms:g} ms", f"{facts.period_ns / 1e6:g} ms")
    table.add_row("security version", str(manifest.security_version), f"{facts.store.least_security_version} or more")
    table.add_row("bytes", str(length), f"{facts.capacity} at most")
    for slot, held in zip(Slot, facts.store.slots, strict=True):
        table.add_row(f"slot {slot.name}", "", f"{held.phase.name.lower()} {held.name}".strip())
    return table
