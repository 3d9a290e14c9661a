"""The commands for release bundles, `stillwake bundle sign|inspect|diff|renew|keylist`, and `stillwake keygen`."""

import secrets
from datetime import date
from pathlib import Path
from typing import Annotated

import typer
from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey
from rich.markup import escape

from contract.atomic import replacing
from contract.config.loading import Loaded
from contract.errors import BundleError, KeyFileError, StillwakeError
from contract.printable import quoted
from contract.release import bundle as bundles
from contract.release import key_list, signing
from contract.release.checks import Bundle, Check, dbc_sha256, sha256
from contract.release.container import read_files
from contract.release.difference import described, differences, is_image, opened
from contract.release.key_list import KeyList
from contract.release.manifest import FIRST_SECURITY_VERSION, SpeedRange
from contract.release.signing import PublicKey
from contract.shipped import BUNDLE
from stillwake.console import options as shared
from stillwake.console.outputs import check_apart, check_output
from stillwake.console.progress import progress
from stillwake.console.settings import settings
from stillwake.console.terminal import console, print_table
from stillwake.parts.releases import describe, locate, open_release, signature
from stillwake.parts.training import fitted_estimator


class NotComparedError(StillwakeError):
    """The error that `diff` raises if it cannot read a bundle."""

    status = 2


bundle = typer.Typer(
    no_args_is_help=True, help="Release bundles: sign, verify, show their contents, list the keys that may sign."
)

DataSet = Annotated[Path | None, typer.Option("--dataset", help="Data set for a new sensor estimator; takes minutes.")]
SecurityVersion = Annotated[
    int | None,
    typer.Option(help="ECUs that have confirmed a greater version refuse the bundle.", min=FIRST_SECURITY_VERSION),
]
Speeds = Annotated[
    str | None, typer.Option(metavar="SLOWEST:FASTEST", help="Smaller range of speed / design speed: 0.7:1.3.")
]
BillFile = Annotated[Path | None, typer.Option(help="Write the bill of materials, CycloneDX 1.6.", metavar="FILE")]
Revoked = Annotated[
    list[Path], typer.Option("--revoke", help="Public key that may no longer sign (repeatable).", metavar="PUB")
]


def keygen(
    path: Annotated[Path, typer.Argument(help="Folder for release.key and release.pub, or file for a secret.")],
    secret: Annotated[
        bool,
        typer.Option("--secret", help="Make a secret for frames (bus.key) or for a tester's access, not a key pair."),
    ] = False,
) -> None:
    """Make a key pair. release.key signs and must be kept secret; release.pub is for everyone who checks signatures.

    With --secret the command writes a secret instead: 128 random bits as hexadecimal digits. For authenticated frames,
    name the file of the secret in `bus.key` on both nodes; for a tester's access, name the file with --access. Frames
    and access need different secrets. An existing file is never overwritten.
    """
    if secret:
        from can_bridge.secoc.key import KEY_LENGTH, write_key

        write_key(path, secrets.token_bytes(KEY_LENGTH))
        console.print(f"wrote {path}: keep it secret; for frames use --set bus.key={path}, for access --access {path}")
        return
    public = signing.write_key_pair(path, Ed25519PrivateKey.generate())
    console.print(f"wrote {path / signing.PRIVATE_KEY} and {path / signing.PUBLIC_KEY}: key {public.fingerprint}")


@bundle.command()
def sign(path: Annotated[Path, typer.Argument(help="Bundle directory.")], key: shared.PrivateKey) -> None:
    """Verify a bundle and write its signature into the bundle; an older signature is replaced."""
    from export.release.judged import judge

    signed = bundles.sign(path, signing.read_private_key(key), judge)
    console.print(*describe(signed), sep="\n")
    _renew_bill(path, signed)


@bundle.command()
def renew(
    path: Annotated[Path, typer.Argument(help="Bundle directory; its DBC may be of another version.")],
    output: Annotated[Path, typer.Argument(help="Bundle directory to write.")],
    name: Annotated[str, typer.Option(help="Name of the new bundle.")],
    key: shared.PrivateKey,
    trust: shared.Trust = None,
    dataset: DataSet = None,
    security_version: SecurityVersion = None,
    hardware: Annotated[str | None, typer.Option(help="Name of the only ECU hardware that accepts the bundle.")] = None,
    speeds: Speeds = None,
    overwrite: shared.Overwrite = False,
    given: shared.Settings = [],  # noqa: B006
) -> None:
    """Make a new bundle from an existing bundle's controller and this version's stillwake.dbc, and sign the new bundle.

    The old bundle must be valid except for its DBC. The new bundle states the old bundle's hash. With --set
    operating_point.speed=12.5, or another setting of the section operating_point, the new bundle is for another vehicle
    or speed; with --set mpc.weights.lift=0.1 the new bundle has other weights of the cost. --security-version and
    --hardware decide which ECUs accept the new bundle when it is flashed. The sensor estimator of the old bundle is
    copied; with --dataset the new bundle gets a new estimator, fitted to this data set.
    """
    from export.release.judged import judge

    check_output(output, overwrite=overwrite, folder=True)
    _, trusted = locate(path, trust)
    private = signing.read_private_key(key)
    loaded = settings("bundle renew", given, uses=["operating_point", "mpc.weights"])
    with progress("batches") as report:
        made = None
        if dataset is not None:
            old = bundles.load(path, trusted, any_dbc=True).manifest
            made = fitted_estimator(dataset, old.sensors, old.window, report)
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
            estimator=made,
            judge=judge,
        )
    console.print(*describe(renewed), sep="\n")
    console.print(f"wrote {output}")
    _renew_bill(output, renewed)


def _renew_bill(path: Path, release: Bundle) -> None:
    """Update the bill of materials beside a bundle, if there is one. The bill states the bundle's digest and signer."""
    from export.release.sbom import bill_beside, release_bom, write_bom

    if bill_beside(path).exists():
        console.print(f"wrote {write_bom(path, release_bom(release, read_files(path)))}")


def _speeds(text: str) -> SpeedRange:
    try:
        slowest, fastest = map(float, text.split(":"))
    except ValueError as error:
        raise BundleError(f"--speeds {quoted(text)}: must be two numbers, such as 0.7:1.3") from error
    return SpeedRange(slowest=slowest, fastest=fastest)


def _given(loaded: Loaded, section: str, values: object) -> dict[str, float]:
    names = [name.removeprefix(section) for name in loaded.given if name.startswith(section)]
    return {name: getattr(values, name) for name in names}


@bundle.command()
def inspect(
    path: Annotated[
        Path | None, typer.Argument(help="Bundle directory, image (.swi) or key list; default: the shipped bundle.")
    ] = None,
    trust: shared.Trust = None,
    sbom: BillFile = None,
) -> None:
    """Verify a bundle, an image or a key list, and show its contents and its signer.

    For a bundle, the command prints one line for each check of the loader, and one line for a control step. If a check
    fails, the contents are not shown and the exit status is 1. A key list may have any signer, unless --trust names the
    root key.
    """
    if path is not None and (key_list.is_list(path) or is_image(path)):
        if sbom is not None:
            raise BundleError("--sbom: needs a bundle, but this file is an image or a key list")
        if key_list.is_list(path):
            _show(*_opened_list(path, locate(path, trust)[1]))
        else:
            print_table("image", "", rows=list(described(opened(*locate(path, trust))).items()))
        return
    if sbom is not None:
        check_apart(BUNDLE if path is None else path, sbom)
        check_output(sbom, overwrite=None)
    _verify(*locate(path, trust))
    release = open_release(path, trust)
    print_table("bundle", "", rows=rows(release))
    if sbom is not None:
        from export.release.sbom import release_bom

        content = release_bom(release, read_files(BUNDLE if path is None else path))
        with replacing(sbom) as temporary:
            temporary.write_bytes(content)
        console.print(f"wrote {sbom}")


def _verify(where: Path, trusted: PublicKey | None) -> None:
    checks = bundles.examine(where, trusted)
    if all(check.error is None for check in checks):
        checks.append(_first_step(bundles.load(where, trusted)))
    for check in checks:
        mark = "[green]ok[/]    " if check.error is None else "[red]FAILED[/]"
        console.print(f"{mark} {escape(check.name):15s} {escape(check.found or str(check.error))}", markup=True)
    failed = [check.name for check in checks if check.error is not None]
    if failed:
        raise BundleError(f"bundle {where}: {len(failed)} of {len(checks)} checks failed: {', '.join(failed)}")


def _first_step(release: Bundle) -> Check:
    """Run one step of each ONNX graph with limited time and memory; compare inputs and outputs with the manifest."""
    # ONNX Runtime is imported here, because its import takes a while and leaves a file in the temporary folder.
    from contract.runtime.onnx_session import OnnxController, OnnxEstimator

    try:
        controller = OnnxController.of(release)
        OnnxEstimator.of(release)
    except BundleError as error:
        return Check(name="first step", error=error)
    return Check(name="first step", found=controller.description)


@bundle.command()
def diff(
    a: Annotated[Path, typer.Argument(help="Bundle directory or image.")],
    b: Annotated[Path, typer.Argument(help="Bundle directory or image to compare with.")],
) -> None:
    """Show the differences between two bundles (manifest, signer, hashes of files), or between two images (.swi).

    The exit status is 0 if there is no difference, 1 if there are differences, and 2 if a bundle or an image cannot be
    read or does not verify. A bundle with the stillwake.dbc of another version is accepted.
    """
    try:
        found = differences(a, b)
    except StillwakeError as error:
        raise NotComparedError(str(error)) from error
    if not found:
        console.print("no difference")
        return
    print_table("differs", str(a), str(b), rows=found)
    raise typer.Exit(1)


@bundle.command()
def keylist(
    path: Annotated[Path, typer.Argument(help="Key list to write; an existing file is never overwritten.")],
    key: shared.PrivateKey,
    version: Annotated[int, typer.Option(help="Version of the list; an ECU accepts only a greater version.")],
    allow: Annotated[list[Path], typer.Option("--allow", help="Public key that may sign (repeatable).", metavar="PUB")],
    revoke: Revoked = [],  # noqa: B006
) -> None:
    """Make the list of the keys that may sign releases for an ECU, and sign the list with the root key.

    An ECU gets its root key at production. The ECU accepts every list that the root key signed and that has a greater
    version than the ECU's present list. `stillwake keygen FOLDER` makes a root key, like any other key.
    """
    check_output(path, overwrite=None)
    private = signing.read_private_key(key)
    allowed, revoked = (frozenset(map(signing.read_public_key, paths)) for paths in (allow, revoke))
    made = KeyList(version=version, keys=allowed, revoked=revoked)
    with replacing(path) as temporary:
        temporary.write_bytes(key_list.encode(made, private))
    _show(made, signing.public_key(private))
    console.print(f"wrote {path}")


def _opened_list(path: Path, root: PublicKey | None) -> tuple[KeyList, PublicKey]:
    try:
        raw = path.read_bytes()
    except OSError as error:
        raise KeyFileError(f"key list {path}: {error.strerror or error}") from error
    signer = root if root is not None else key_list.signer(raw)
    return key_list.decode(raw, signer), signer


def _show(listed: KeyList, root: PublicKey) -> None:
    rows = [("may sign", one) for one in sorted(key.fingerprint for key in listed.keys)]
    rows += [("revoked", one) for one in sorted(key.fingerprint for key in listed.revoked)]
    print_table(f"key list {listed.version}", f"signed by {root.fingerprint}", rows=rows)


def rows(release: Bundle) -> list[tuple[str, str]]:
    """Return the name and the text of each value that `inspect` shows from a bundle's manifest."""
    manifest = release.manifest
    mpc, point, scaling = manifest.mpc, manifest.operating_point, manifest.scaling
    weights = ", ".join(f"{name} {value:g}" for name, value in vars(mpc.weights).items())
    optimiser = f"{mpc.iterations} iterations, learning rate {mpc.learning_rate:g}"
    positions = zip(manifest.sensors, manifest.sensor_positions or (), strict=manifest.sensor_positions is not None)
    speeds = manifest.speeds
    served = "all; each is treated as U_inf" if speeds is None else f"{speeds.slowest:g} to {speeds.fastest:g} U_inf"
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
        ("timing", f"control period {manifest.control_period:g} t_c, {manifest.budget_ms:g} ms, with "
         f"{manifest.compute_time_ms:g} ms for the control step"),
        *((f"scaling {name}", f"Cp {mean:.4f} +- {std:.4f}") for name, mean, std in ranges),
        ("scaling action", f"{scaling.action_std:.4f}"),
        *((f"scaling {name}", f"{mean:.4f} +- {std:.4f}")
          for name, mean, std in zip(("Cd", "Cl"), scaling.force_mean, scaling.force_std, strict=True)),
        *((f"sensor estimate {name}", f"Cp +- {manifest.sensor_estimator.fast[j][j]:.4f} from the other sensors")
          for j, name in enumerate(manifest.sensors) if manifest.sensor_estimator is not None),
        ("data set SHA-256", manifest.dataset_sha256),
        ("weights SHA-256", manifest.weights_sha256),
        ("program SHA-256", manifest.program_sha256),
        ("DBC SHA-256", dbc_sha256()),
        *((f"file {name}", f"{len(data)} bytes, {sha256(data)}") for name, data in release.files.items()),
    ]  # fmt: skip
