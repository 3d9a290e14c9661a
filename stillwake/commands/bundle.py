"""The commands for release bundles: `stillwake bundle keygen|sign|verify|inspect`, and how a bundle is opened."""

from importlib.resources import files
from pathlib import Path
from typing import Annotated, Final

import typer
from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey
from rich.markup import escape
from rich.table import Table

from contract import bundle as bundles
from contract import signing
from contract.bundle import Bundle
from contract.errors import BundleError
from contract.signing import PublicKey
from stillwake.terminal import console

SHIPPED_BUNDLE: Final = Path(str(files("firmware_sim").joinpath("data/bundle")))
PROJECT: Final = "project"
"""Stands for the key that the shipped bundle is signed with, where a key file may be named."""

bundle = typer.Typer(no_args_is_help=True, help="Release bundles: make keys, sign, verify, show what is inside.")

Trust = Annotated[
    str | None,
    typer.Option(
        "--trust",
        help="Public key file (PEM) of whoever must have signed the bundle; 'project' is the key of the shipped one.",
    ),
]
BundlePath = Annotated[Path | None, typer.Argument(help="Bundle directory or .zip; default: the shipped one.")]
KeyFile = Annotated[Path, typer.Option("--key", help="Private key file (PEM), as `bundle keygen` writes it.")]


@bundle.command()
def keygen(folder: Annotated[Path, typer.Argument(help="Folder to write release.key and release.pub into.")]) -> None:
    """Make a key pair: release.key signs and stays secret, release.pub is for everyone who is to trust it."""
    public = signing.write_key_pair(folder, Ed25519PrivateKey.generate())
    wrote = f"wrote {folder / signing.PRIVATE_KEY} and {folder / signing.PUBLIC_KEY}"
    console.print(f"{wrote}: key {public.fingerprint}", soft_wrap=True)


@bundle.command()
def sign(path: Annotated[Path, typer.Argument(help="Bundle directory or .zip.")], key: KeyFile) -> None:
    """Verify a bundle and sign it in place; an older signature is replaced."""
    signed = bundles.sign(path, signing.read_private_key(key))
    console.print(*headline(signed), sep="\n", soft_wrap=True)


@bundle.command()
def verify(path: BundlePath = None, trust: Trust = None) -> None:
    """Make every check that loading makes, one line each, and fail if one of them does."""
    where, trusted = _where(path, trust)
    checks = bundles.examine(where, trusted)
    for check in checks:
        mark = "[green]ok[/]    " if check.error is None else "[red]FAILED[/]"
        console.print(f"{mark} {escape(check.name):15s} {escape(check.found or str(check.error))}", soft_wrap=True)
    failed = [check.name for check in checks if check.error is not None]
    if failed:
        raise BundleError(f"bundle {where}: {len(failed)} of {len(checks)} checks failed: {', '.join(failed)}")


@bundle.command()
def inspect(path: BundlePath = None, trust: Trust = None) -> None:
    """Show what a bundle holds and who signed it; a bundle that does not verify is refused."""
    release = open_release(path, trust)
    table = Table("bundle", "")
    table.columns[1].overflow = "fold"
    for name, value in rows(release):
        table.add_row(name, escape(value))
    console.print(table)


def open_release(path: Path | None, trust: str | None) -> Bundle:
    """Load a bundle, or the shipped one, which must be the project's unless another key is to be trusted.

    Raises:
        BundleError: it does not verify, or is not signed as demanded.
        KeyFileError: the key to trust cannot be read.
    """
    return bundles.load(*_where(path, trust))


def headline(release: Bundle) -> list[str]:
    """What to say when a bundle is opened: its name and sensors, and what its signature is worth."""
    manifest = release.manifest
    vouched_for = release.is_trusted or release.signer == signing.project_key()
    return [
        f"bundle {manifest.name} {release.digest[:12]}: {', '.join(manifest.sensors)}",
        signature(release) if vouched_for else f"[yellow]warning: {signature(release)}[/]",
    ]


def signature(release: Bundle) -> str:
    """Who signed it, in words."""
    if release.signer is None:
        return bundles.UNSIGNED
    if release.signer == signing.project_key():
        return f"signed by the project's key {release.signer.fingerprint}"
    if release.is_trusted:
        return f"signed by the trusted key {release.signer.fingerprint}"
    return f"signed by key {release.signer.fingerprint}: unknown here, --trust would demand it"


def rows(release: Bundle) -> list[tuple[str, str]]:
    """Everything a manifest ties together, by name."""
    manifest = release.manifest
    mpc, point, scaling = manifest.mpc, manifest.operating_point, manifest.scaling
    weights = ", ".join(f"{name} {value:g}" for name, value in vars(mpc.weights).items())
    ranges = zip(manifest.sensors, scaling.pressure_mean, scaling.pressure_std, strict=True)
    return [
        ("name", manifest.name),
        ("created", manifest.created),
        ("signature", signature(release)),
        ("digest", release.digest),
        ("precision", manifest.precision),
        ("sensors", ", ".join(manifest.sensors)),
        ("window", f"{manifest.window} control steps"),
        ("MPC", f"horizon {mpc.horizon}, {mpc.iterations} iterations, learning rate {mpc.learning_rate:g}, "
         f"drag reference {mpc.drag_reference:g}"),
        ("MPC weights", weights),
        ("limit", f"|a| <= {manifest.action_limit:g} U_inf W"),
        ("operating point", f"W {point.width:g} m, U_inf {point.speed:g} m/s, rho {point.density:g} kg/m3"),
        ("timing", f"control period {manifest.control_period:g} t_c, {manifest.budget_ms:g} ms; of it "
         f"{manifest.compute_time_ms:g} ms for the control step"),
        *((f"scaling {name}", f"Cp {mean:.4f} +- {std:.4f}") for name, mean, std in ranges),
        ("scaling action", f"{scaling.action_std:.4f}"),
        *((f"scaling {name}", f"{mean:.4f} +- {std:.4f}")
          for name, mean, std in zip(("Cd", "Cl"), scaling.force_mean, scaling.force_std, strict=True)),
        ("data set SHA-256", manifest.dataset_sha256),
        ("weights SHA-256", manifest.weights_sha256),
        ("program SHA-256", manifest.program_sha256),
        ("DBC SHA-256", bundles.dbc_sha256()),
        *((f"file {name}", f"{len(data)} bytes, {bundles.sha256(data)}") for name, data in release.files.items()),
    ]  # fmt: skip


def _where(path: Path | None, trust: str | None) -> tuple[Path, PublicKey | None]:
    if trust == PROJECT or (trust is None and path is None):
        trusted: PublicKey | None = signing.project_key()
    else:
        trusted = None if trust is None else signing.read_public_key(Path(trust))
    return SHIPPED_BUNDLE if path is None else path, trusted
