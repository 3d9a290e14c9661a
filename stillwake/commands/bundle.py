"""The commands for release bundles: `stillwake bundle keygen|sign|verify|inspect|sbom|diff|renew|keylist`."""

from datetime import date
from functools import partial
from pathlib import Path
from typing import Annotated, Final

import typer
from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey
from rich.markup import escape
from rich.table import Column

from contract.atomic import replacing
from contract.config.loading import Loaded
from contract.errors import BundleError, KeyFileError, StillwakeError
from contract.printable import quoted
from contract.release import bundle as bundles
from contract.release import key_list, signing
from contract.release.checks import Bundle, Check, dbc_sha256, sha256
from contract.release.container import read_files
from contract.release.difference import differences
from contract.release.image_contents import described, is_image, opened
from contract.release.key_list import KeyList
from contract.release.manifest import SpeedRange
from contract.release.signing import PublicKey
from contract.shipped import BUNDLE
from stillwake.console.outputs import Overwrite, check_output
from stillwake.console.settings import settings
from stillwake.console.terminal import Overrides, console, print_table, progress_bar
from stillwake.parts.fitted_estimator import fitted_estimator
from stillwake.parts.releases import Trust, describe, locate, open_release, signature


class NotComparedError(StillwakeError):
    """A bundle that `diff` cannot read."""

    status = 2


bundle = typer.Typer(no_args_is_help=True, help="Release bundles: make keys, sign, verify, show what is inside.")

BundlePath = Annotated[Path | None, typer.Argument(help="Bundle directory; default: the shipped one.")]
DIFFERENT: Final = 1
"""Exit status of `diff`, as of diff(1)."""

KeyFile = Annotated[Path, typer.Option("--key", help="Private key file (PEM), as `bundle keygen` writes it.")]


@bundle.command()
def keygen(folder: Annotated[Path, typer.Argument(help="Folder to write release.key and release.pub into.")]) -> None:
    """Make a key pair: release.key signs and stays secret, release.pub is for everyone who is to trust it."""
    public = signing.write_key_pair(folder, Ed25519PrivateKey.generate())
    wrote = f"wrote {folder / signing.PRIVATE_KEY} and {folder / signing.PUBLIC_KEY}"
    console.print(f"{wrote}: key {public.fingerprint}")


@bundle.command()
def sign(path: Annotated[Path, typer.Argument(help="Bundle directory.")], key: KeyFile) -> None:
    """Verify a bundle and sign it in place; an older signature is replaced."""
    from export.release.judged import judge

    signed = bundles.sign(path, signing.read_private_key(key), judge)
    console.print(*describe(signed), sep="\n")


@bundle.command()
def renew(
    path: Annotated[Path, typer.Argument(help="Bundle directory; its DBC may be another version's.")],
    output: Annotated[Path, typer.Argument(help="Bundle directory.")],
    name: Annotated[str, typer.Option(help="Name of the new bundle.")],
    key: KeyFile,
    trust: Trust = None,
    sensors: Annotated[
        Path | None,
        typer.Option(
            metavar="DATASET", help="Fit a new sensor estimator for the bundle, from this data set: takes minutes."
        ),
    ] = None,
    security_version: Annotated[
        int | None,
        typer.Option(help="An ECU that confirmed a greater one refuses this bundle; default: the old one's.", min=0),
    ] = None,
    hardware: Annotated[
        str | None, typer.Option(help="Name of the only ECU hardware it may be flashed to; default: the old one's.")
    ] = None,
    speeds: Annotated[
        str | None,
        typer.Option(metavar="SLOWEST:FASTEST", help="A smaller range of speeds, in design speeds, such as 0.7:1.3."),
    ] = None,
    overwrite: Overwrite = False,
    overrides: Overrides = [],  # noqa: B006
) -> None:
    """Make a bundle of the same controller for this version's stillwake.dbc, and sign it.

    The old bundle must be in order but for its DBC. The new one names it by its hash.
    With --set operating_point.speed=12.5, or another setting of that section, it is for another vehicle or speed; with
    --set mpc.weights.lift=0.1 it has other weights of the cost. --security-version and --hardware decide which ECUs
    take it when it is flashed. A sensor estimator that it has is kept; with --sensors it gets one, or another one.
    """
    from export.release.judged import judge

    check_output(output, overwrite=overwrite, folder=True)
    _, trusted = locate(path, trust)
    private = signing.read_private_key(key)
    loaded = settings("bundle renew", None, overrides, uses=["operating_point", "mpc.weights"])
    with progress_bar("batches") as bar:
        renewed = bundles.renew(
            path,
            output,
            name=name,
            created=date.today().isoformat(),
            key=private,
            trusted=trusted,
            operating_point=_given(loaded, "operating_point.", loaded.config.operating_point),
            weights=_given(loaded, "mpc.weights.", loaded.config.mpc.weights),
            security_version=security_version,
            hardware=hardware,
            speeds=None if speeds is None else _speeds(speeds),
            estimator=None if sensors is None else partial(fitted_estimator, sensors, bar),
            judge=judge,
        )
    console.print(*describe(renewed), sep="\n")
    console.print(f"wrote {output}")


def _speeds(text: str) -> SpeedRange:
    try:
        slowest, fastest = map(float, text.split(":"))
    except ValueError as error:
        raise BundleError(f"--speeds {quoted(text)}: must be two numbers, such as 0.7:1.3") from error
    return SpeedRange(slowest=slowest, fastest=fastest)


def _given(loaded: Loaded, section: str, values: object) -> dict[str, float]:
    """What the user set of a section, by name."""
    names = [name.removeprefix(section) for name in loaded.given if name.startswith(section)]
    return {name: getattr(values, name) for name in names}


@bundle.command()
def verify(path: BundlePath = None, trust: Trust = None) -> None:
    """Make every check that loading makes, one line each, and fail if one of them does."""
    where, trusted = locate(path, trust)
    checks = bundles.examine(where, trusted)
    if all(check.error is None for check in checks):
        checks.append(_first_step(bundles.load(where, trusted)))
    for check in checks:
        mark = "[green]ok[/]    " if check.error is None else "[red]FAILED[/]"
        line = f"{mark} {escape(check.name):15s} {escape(check.found or str(check.error))}"
        console.print(line, markup=True)
    failed = [check.name for check in checks if check.error is not None]
    if failed:
        raise BundleError(f"bundle {where}: {len(failed)} of {len(checks)} checks failed: {', '.join(failed)}")


def _first_step(release: Bundle) -> Check:
    """A step of each graph, in bounded time and memory, with the inputs and outputs that the manifest gives them."""
    # ONNX Runtime takes a while to load, and leaves a file in the temporary folder: other commands do without.
    from contract.runtime.onnx_estimator import OnnxEstimator
    from contract.runtime.onnx_session import OnnxController

    try:
        controller = OnnxController.of(release)
        OnnxEstimator.of(release)
    except BundleError as error:
        return Check(name="first step", error=error)
    return Check(name="first step", found=controller.description)


@bundle.command()
def inspect(path: BundlePath = None, trust: Trust = None) -> None:
    """Show what a bundle or a controller image (.swi) holds and who signed it; one that does not verify is refused."""
    if path is not None and is_image(path):
        found = list(described(opened(*locate(path, trust))).items())
    else:
        found = rows(open_release(path, trust))
    print_table("bundle", _folded(""), rows=found)


@bundle.command()
def sbom(
    output: Annotated[Path, typer.Argument(help="File to write, for example release.cdx.json.")],
    path: BundlePath = None,
    trust: Trust = None,
    overwrite: Overwrite = False,
) -> None:
    """Verify a bundle and write its bill of materials, CycloneDX 1.6: files, model, data set, tools, with hashes.

    `export` writes one next to every bundle.
    """
    check_output(output, overwrite=overwrite)

    from export.release.sbom import release_bom

    content = release_bom(open_release(path, trust), read_files(BUNDLE if path is None else path))
    with replacing(output) as temporary:
        temporary.write_bytes(content)
    console.print(f"wrote {output}")


@bundle.command()
def diff(
    a: Annotated[Path, typer.Argument(help="Bundle directory.")],
    b: Annotated[Path, typer.Argument(help="Another one.")],
    trust: Trust = None,
) -> None:
    """Show what differs between two bundles, manifest, signer and files by their hashes, or between two images (.swi).

    Ends with 0 if they are the same, 1 if they differ, and 2 if one of them cannot be read or does not verify. They may
    be of other versions' stillwake.dbc.
    """
    try:
        _, trusted = locate(a, trust)
        found = differences(a, b, trusted)
    except StillwakeError as error:
        raise NotComparedError(str(error)) from error
    if not found:
        console.print("no difference")
        return
    print_table("differs", _folded(str(a)), _folded(str(b)), rows=found)
    raise typer.Exit(DIFFERENT)


@bundle.command()
def keylist(
    path: Annotated[Path, typer.Argument(help="Key list to write, or to show.")],
    root: Annotated[
        Path | None,
        typer.Option(help="Root key file (PEM): private to make a list, public to demand whose a shown one must be."),
    ] = None,
    version: Annotated[
        int | None, typer.Option(help="Of the list; an ECU takes only a greater one than it has.")
    ] = None,
    key: Annotated[
        list[Path], typer.Option(help="Public key file (PEM) that may sign releases (repeatable).", metavar="PUB")
    ] = [],  # noqa: B006
    revoke: Annotated[
        list[Path], typer.Option(help="Public key file (PEM) that must not any more (repeatable).", metavar="PUB")
    ] = [],  # noqa: B006
    show: Annotated[bool, typer.Option("--show", help="Show a list that is there.")] = False,
    overwrite: Overwrite = False,
) -> None:
    """Make the list of the keys that may sign releases for an ECU, signed by the root key, or show one.

    An ECU knows its root key from production on, and takes every list that this key signed and that has a greater
    version than its own. A root key is made like any other: `stillwake bundle keygen FOLDER`.
    """
    if show:
        if version is not None or key or revoke:
            raise KeyFileError("--show takes no --version, --key or --revoke: it shows what is in the list")
        _show(*_opened_list(path, None if root is None else signing.read_public_key(root)))
        return
    if root is None or version is None or not key:
        raise KeyFileError("give --root, --version and at least one --key to make a list, or --show to see one")
    check_output(path, overwrite=overwrite)
    private = signing.read_private_key(root)
    allowed, revoked = (frozenset(map(signing.read_public_key, paths)) for paths in (key, revoke))
    made = KeyList(version=version, keys=allowed, revoked=revoked)
    raw = key_list.encode(made, private)
    with replacing(path) as temporary:
        temporary.write_bytes(raw)
    _show(made, signing.public_key(private))
    console.print(f"wrote {path}")


def _opened_list(path: Path, root: PublicKey | None) -> tuple[KeyList, PublicKey]:
    """The list in a file and who signed it: any key, unless one is demanded."""
    try:
        raw = path.read_bytes()
    except OSError as error:
        raise KeyFileError(f"key list {path}: {error.strerror or error}") from error
    signer = root if root is not None else key_list.signer(raw)
    return key_list.decode(raw, signer), signer


def _show(listed: KeyList, root: PublicKey) -> None:
    rows = (
        (what, fingerprint)
        for what, found in (("may sign", listed.keys), ("revoked", listed.revoked))
        for fingerprint in sorted(one.fingerprint for one in found)
    )
    print_table(f"key list {listed.version}", _folded(f"signed by {root.fingerprint}"), rows=rows)


def _folded(head: str) -> Column:
    """A column whose texts are never cut."""
    return Column(head, overflow="fold")


def rows(release: Bundle) -> list[tuple[str, str]]:
    """Everything a manifest ties together, by name."""
    manifest = release.manifest
    mpc, point, scaling = manifest.mpc, manifest.operating_point, manifest.scaling
    weights = ", ".join(f"{name} {value:g}" for name, value in vars(mpc.weights).items())
    optimiser = f"{mpc.iterations} iterations, learning rate {mpc.learning_rate:g}"
    positions = zip(manifest.sensors, manifest.sensor_positions or (), strict=manifest.sensor_positions is not None)
    speeds = manifest.speeds
    served = "all, each taken for U_inf" if speeds is None else f"{speeds.slowest:g} to {speeds.fastest:g} U_inf"
    ranges = zip(manifest.sensors, scaling.pressure_mean, scaling.pressure_std, strict=True)
    return [
        ("name", manifest.name),
        ("created", manifest.created),
        ("signature", signature(release)),
        ("digest", release.digest),
        ("security version", str(manifest.security_version)),
        ("hardware", "any" if manifest.hardware is None else manifest.hardware),
        ("precision", manifest.precision),
        ("sensors", ", ".join(manifest.sensors)),
        *((f"position {name}", f"x {x:+.4f} W, y {y:+.4f} W") for name, (x, y) in positions),
        ("window", f"{manifest.window} control steps"),
        ("MPC", f"horizon {mpc.horizon}, {optimiser}, drag reference {mpc.drag_reference:g}"),
        ("MPC weights", weights),
        ("limit", f"|a| <= {manifest.action_limit:g} U_inf W"),
        ("operating point", f"W {point.width:g} m, U_inf {point.speed:g} m/s, rho {point.density:g} kg/m3"),
        ("speeds", served),
        ("timing", f"control period {manifest.control_period:g} t_c, {manifest.budget_ms:g} ms; of it "
         f"{manifest.compute_time_ms:g} ms for the control step"),
        *((f"scaling {name}", f"Cp {mean:.4f} +- {std:.4f}") for name, mean, std in ranges),
        ("scaling action", f"{scaling.action_std:.4f}"),
        *((f"scaling {name}", f"{mean:.4f} +- {std:.4f}")
          for name, mean, std in zip(("Cd", "Cl"), scaling.force_mean, scaling.force_std, strict=True)),
        *((f"sensor estimate {name}", f"Cp +- {manifest.sensor_estimator.fast[j][j]:.4f} by the others")
          for j, name in enumerate(manifest.sensors) if manifest.sensor_estimator is not None),
        ("data set SHA-256", manifest.dataset_sha256),
        ("weights SHA-256", manifest.weights_sha256),
        ("program SHA-256", manifest.program_sha256),
        ("DBC SHA-256", dbc_sha256()),
        *((f"file {name}", f"{len(data)} bytes, {sha256(data)}") for name, data in release.files.items()),
    ]  # fmt: skip
