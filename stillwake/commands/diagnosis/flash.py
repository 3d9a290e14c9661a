"""The command `stillwake flash`, which sends a release, or a list of signing keys, to an ECU over its CAN bus."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Final

import typer
from rich.table import Table

from contract.config.vehicle import BusConfig
from contract.errors import ConfigError, KeyFileError
from contract.release.checks import Bundle
from stillwake.commands.diagnosis import asking
from stillwake.console import options as shared
from stillwake.console.progress import progress, span
from stillwake.console.settings import TESTERS_BUS, settings, with_bus
from stillwake.console.stopping import go_on_with
from stillwake.console.terminal import console
from stillwake.parts.releases import describe, locate, open_release

if TYPE_CHECKING:
    from can_bridge.tester.facts import EcuFacts
    from can_bridge.tester.sequence import Flashed, Step


MOST_KEY_BYTES: Final = 4092
"""Largest size of a key list in bytes: the 4,095 bytes of a UDS request minus 3 bytes for service and identifier."""
Keys = Annotated[Path | None, typer.Option(help="Key list to send first (`bundle keylist`).", metavar="LIST")]
DryRun = Annotated[bool, typer.Option("--dry-run", help="Ask the ECU, check everything, and write nothing.")]


def flash(
    bundle: Annotated[
        Path | None, typer.Argument(help="Release bundle, or image (.swi) for an ECU in C; optional with --keys.")
    ] = None,
    keys: Keys = None,
    bus: shared.Bus = None,
    access: shared.Access = None,
    trust: shared.Trust = None,
    dry_run: DryRun = False,
    no_confirm: Annotated[bool, typer.Option("--no-confirm", help="Leave the release on trial, unconfirmed.")] = False,
    given: shared.Settings = [],  # noqa: B006
) -> None:
    """Transfer a release to an ECU over UDS, start the release on trial, test it, and confirm it.

    The jets must be shut and the vehicle must not request control. The ECU continues to use its old release until the
    new release has passed its self-test. If the command is interrupted, the same command continues the transfer where
    it stopped. If the release already runs, nothing is done.

    The ECU accepts a key list if the ECU's root key signed the list, the list is newer than the ECU's present list, and
    the list contains the key of the confirmed release. If a release is given, too, a list whose version the ECU already
    has is not sent again.

    Exit status: 3 if the ECU does not answer; 4 if the access key is wrong; 5 if the vehicle is in use; 6 if the
    release or the list is not for this ECU, or the ECU refused it; 7 if the ECU refused something else; 8 if the new
    release did not start or did not pass its self-test, so that the previous release runs.

    stillwake flash contract/release/shipped --bus socketcan:can0 --access access.key

    stillwake flash --keys new.keys --bus socketcan:can0 --access access.key
    """
    if bundle is None and keys is None:
        raise ConfigError("name the bundle or image to flash, or a key list with --keys")
    config = settings("flash", with_bus(bus, given), uses=TESTERS_BUS).config
    if access is None and (keys is not None or not dry_run):
        raise ConfigError("--access: must name the ECU's key file; only --dry-run needs no key")
    if keys is not None and dry_run:
        raise ConfigError("--keys: the key list is written at once; leave it out with --dry-run")
    if bundle is None and (trust is not None or no_confirm):
        raise ConfigError("--trust, --no-confirm: apply to a release; leave them out, or name a bundle or image")
    # The release is opened before the key list is sent, so that nothing is sent if the release cannot be used.
    opened = None if bundle is None else _opened(bundle, trust)
    if keys is not None:
        from can_bridge.tester.transfer import bring

        raw = _read(keys)
        with asking(config.bus, access) as ecu:
            # If an earlier call was interrupted, the ECU may already have the list; this call must continue.
            before, after = bring(ecu, raw, is_again=opened is not None)
        console.print(f"the ECU has key list {after}, and had {before or 'none'}")
    if opened is not None:
        _bring_release(opened, config.bus, access, dry_run=dry_run, confirm=not no_confirm)


def _read(path: Path) -> bytes:
    try:
        with path.open("rb") as file:
            raw = file.read(MOST_KEY_BYTES + 1)
    except OSError as error:
        raise KeyFileError(f"key list {path}: {error.strerror or error}") from error
    if not 0 < len(raw) <= MOST_KEY_BYTES:
        raise KeyFileError(f"key list {path}: must have 1 to {MOST_KEY_BYTES} bytes")
    return raw


def _opened(path: Path, trust: str | None) -> tuple[str, bytes, Bundle | None]:
    """Return the release's name, its image and, unless the file is an image, the bundle."""
    from contract.release.container import image_of, read_files
    from contract.release.difference import is_image, opened

    if is_image(path):
        # The ECU itself checks the hardware for which the image was made.
        name, image = opened(*locate(path, trust)).facts.name, path.read_bytes()
        console.print(f"image {name}, {len(image)} bytes")
        return name, image, None
    release = open_release(path, trust)
    console.print(*describe(release), sep="\n")
    return release.manifest.name, image_of(read_files(path)), release


def _bring_release(
    opened: tuple[str, bytes, Bundle | None], bus: BusConfig, access: Path | None, *, dry_run: bool, confirm: bool
) -> None:
    from can_bridge.tester.facts import check_fits
    from can_bridge.tester.sequence import Flashing

    name, image, release = opened

    def judge(facts: "EcuFacts") -> None:
        console.print(f"ECU {facts.serial_number}, {facts.hardware}: runs {_running(facts)}")
        if release is not None:
            if dry_run:
                console.print(_comparison(release, len(image), facts))
            check_fits(release, len(image), facts)

    with (
        asking(bus, access) as ecu,
        progress("bytes") as report,
        go_on_with(lambda: "the ECU keeps the received part; the same command continues there"),
    ):
        received: list[tuple[int, int]] = []

        def show(done: int, length: int) -> None:
            received[:] = [(done, length)]
            report("flash", done, length)

        def on_step(step: "Step") -> None:
            # The note names the step that follows the transfer.
            for done in received:
                report("flash", *done, step.name.lower().replace("_", " "))

        flashing = Flashing(ecu, image, dry_run=dry_run, confirm=confirm, judge=judge, progress=show, on_step=on_step)
        flashed = flashing.run()
    console.print(_ended(flashed, name) + _effort(flashed, len(image)))


def _ended(flashed: "Flashed", name: str) -> str:
    from can_bridge.tester.sequence import End

    running = flashed.after.running_slot
    boots_left = 0 if running is None else running.boots_left
    return {
        End.ALREADY: f"{name} already runs and is confirmed: nothing was done",
        End.WOULD_FLASH: "dry run: no check failed, and nothing was written",
        End.ON_TRIAL: f"{name} runs on trial, {boots_left} boots left; the same command "
        "without --no-confirm confirms it",
        End.CONFIRMED: f"{name} runs, and is confirmed",
    }[flashed.end]


def _running(facts: "EcuFacts") -> str:
    running = facts.store.running_slot
    if running is None:
        return "no release"
    how = "confirmed" if facts.store.active == facts.store.running else "not confirmed"
    return f"{running.name} {running.digest[:12]}, {how}"


def _effort(flashed: "Flashed", length: int) -> str:
    if flashed.resumed_from is None:
        return ""
    again = f", {flashed.unanswered} requests sent again" if flashed.unanswered else ""
    return f"; {length - flashed.resumed_from} bytes sent, {span(flashed.seconds)} in all{again}"


def _comparison(release: Bundle, length: int, facts: "EcuFacts") -> Table:
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
