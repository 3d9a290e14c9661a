"""The checks of a release bundle's files. Nothing is parsed before its signature is verified.

The manifest's own hash detects accidental changes. A signature by a trusted key detects deliberate changes too.

A graph may come from anyone. ONNX Runtime refuses unknown operators. `contract.runtime` refuses wrong inputs, outputs
and shapes, and runs a first step in bounded time and memory. `check_graph` refuses two kinds of content before ONNX
Runtime reads the bytes: constants in other files, and operators outside the ONNX standard. Each kind of content puts a
certain text into the file, and no exported graph contains this text. Before a graph is signed, `export.release.judged`
makes stricter checks.
"""

import hashlib
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import partial
from importlib.resources import files
from pathlib import Path
from typing import Any, Final, TypeVar

from contract import errors
from contract.controller.estimator import ESTIMATOR
from contract.errors import BundleError
from contract.release import signing
from contract.release.manifest import MANIFEST, Manifest, open_manifest, parse
from contract.release.signing import PublicKey

SIGNATURE: Final = "manifest.sig"
CONTROLLER: Final = "controller.onnx"
UNSIGNED: Final = "unsigned: hashes detect damage, but do not prove the origin"
MAX_GRAPH_BYTES: Final = 16 * 2**20
"""Largest size of a graph's file, in bytes: a hundred times the paper's controller in int8."""
FORBIDDEN: Final = {
    b"location": "a constant is in another file: must be in this file",
    b"com.microsoft": "an operator is of ONNX Runtime's domain: must be an operator of ONNX",
    b"ai.onnx.": "an operator is not of ONNX's default domain: must be of this domain",
}
"""Texts that no valid graph contains, and their meanings. A tensor in another file has the key `location`."""
_T = TypeVar("_T")
Trusted = PublicKey | frozenset[PublicKey] | None
"""The trusted keys. One of these keys must have signed the bundle; None if no signature is required."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Bundle:
    """A verified bundle. `files` has all files except manifest and signature. `digest` is the SHA-256 of the manifest,
    which does not depend on the signature; its first 4 bytes are sent on the bus. `signer` is the key of a valid
    signature; None if the bundle is unsigned. `is_trusted` states whether a trusted key was required for loading."""

    manifest: Manifest
    files: Mapping[str, bytes]
    digest: str
    signer: PublicKey | None = None
    is_trusted: bool = False

    @property
    def name(self) -> str:
        return self.manifest.name

    @property
    def security_version(self) -> int:
        return self.manifest.security_version

    @property
    def short_hash(self) -> int:
        return int(self.digest[:8], 16)


@dataclass(frozen=True, kw_only=True)
class Check:
    """The result of one check of a bundle; `error` is None if the check passed."""

    name: str
    found: str = ""
    error: BundleError | None = None


def sha256(data: bytes) -> str:
    """Return the SHA-256 of bytes in hex, as manifests state it."""
    return hashlib.sha256(data).hexdigest()


def dbc_bytes() -> bytes:
    """Return the bytes of this version's DBC."""
    return files("contract").joinpath("stillwake.dbc").read_bytes()


def dbc_sha256() -> str:
    """Return the SHA-256 of this version's DBC in hex, the form in manifests and generated headers."""
    return sha256(dbc_bytes())


@dataclass(kw_only=True)
class Made:
    """The checks made while a bundle is read. With `lists`, the reading continues after a failed check if possible."""

    lists: bool = False
    checks: list[Check] = field(default_factory=list)

    def check(self, name: str, verify: Callable[[], _T], in_words: Callable[[_T], str] = str) -> _T | None:
        """Make a check that other checks do not depend on. If the check fails and `lists` is set, return None."""
        try:
            return self.need(name, verify, in_words)
        except BundleError:
            if not self.lists:
                raise
            return None

    def need(self, name: str, make: Callable[[], _T], in_words: Callable[[_T], str]) -> _T:
        """Compute a value that later checks need. An error ends the reading."""
        try:
            value = make()
        except BundleError as error:
            self.checks.append(Check(name=name, error=error))
            raise
        self.checks.append(Check(name=name, found=in_words(value)))
        return value


def read_checked(
    path: Path,
    contents: Mapping[str, bytes],
    trusted: Trusted = None,
    made: Made | None = None,
    *,
    any_dbc: bool = False,
) -> Bundle:
    """Check a bundle's files and return the bundle. Raises BundleError for a check that fails (see `Made`)."""
    made = Made() if made is None else made
    parts = dict(contents)
    raw, signature = parts.pop(MANIFEST, None), parts.pop(SIGNATURE, None)
    if raw is None:
        error = errors.BundleManifestError(f"bundle {path}: {MANIFEST} is missing")
        made.checks.append(Check(name=MANIFEST, error=error))
        raise error

    def signed_by(key: PublicKey | None) -> str:
        return UNSIGNED if key is None else f"good, by {'the trusted ' if trusted else ''}key {key.fingerprint}"

    signer = made.check(SIGNATURE, lambda: _verify_signature(path, raw, signature, trusted), signed_by)
    opened = made.need(MANIFEST, lambda: open_manifest(path, raw), lambda opened: opened.digest)
    # The names include files that are present, and files that must be present.
    names = sorted({CONTROLLER} | opened.hashes.keys() | parts.keys())
    sound = {name for name in names if made.check(name, partial(_verify_file, path, name, parts, opened.hashes))}
    if not any_dbc:
        made.check("DBC", lambda: _verify_dbc(path, opened.dbc))
    manifest = made.need("content", lambda: parse(path, opened), lambda manifest: manifest.name)
    if CONTROLLER in sound:
        made.check("graph", lambda: check_graph(path, CONTROLLER, parts[CONTROLLER]))
    is_stated = manifest.sensor_estimator is not None
    if ESTIMATOR in sound or (is_stated and ESTIMATOR not in names):
        made.check("sensor graph", lambda: _verify_estimator(path, parts, is_stated=is_stated))
    trusts = trusted is not None
    return Bundle(manifest=manifest, files=parts, digest=opened.digest, signer=signer, is_trusted=trusts)


def _verify_signature(path: Path, raw: bytes, signature: bytes | None, trusted: Trusted) -> PublicKey | None:
    keys = frozenset({trusted}) if isinstance(trusted, PublicKey) else trusted
    allowed = "no key that is trusted" if not keys else " or ".join(sorted(f"key {key.fingerprint}" for key in keys))
    if signature is None:
        if keys is not None:
            raise errors.BundleSignerError(f"bundle {path} is unsigned: must be signed by {allowed}")
        return None
    try:
        signer = signing.signer(signature, raw)
    except ValueError as error:
        raise errors.BundleSignatureError(f"bundle {path}: {SIGNATURE} is damaged ({error})") from error
    if signer is None:
        raise errors.BundleSignatureError(f"bundle {path}: bad signature: {MANIFEST} or {SIGNATURE} was altered")
    if keys is not None and signer not in keys:
        raise errors.BundleSignerError(
            f"bundle {path} is signed by key {signer.fingerprint}: must be signed by {allowed}"
        )
    return signer


def _verify_file(path: Path, name: str, found: Mapping[str, bytes], hashes: Mapping[str, Any]) -> str:
    if name not in found:
        raise errors.BundleFileError(f"bundle {path}: {name} is missing")
    if name not in hashes:
        raise errors.BundleFileError(f"bundle {path}: {name} is not in the manifest")
    digest = sha256(found[name])
    if digest != hashes[name]:
        raise errors.BundleFileError(f"bundle {path}: {name} was altered (SHA-256 does not match the manifest)")
    return digest


def _verify_dbc(path: Path, dbc: object) -> str:
    if dbc != dbc_sha256():
        raise errors.BundleDbcError(
            f"bundle {path} was built for another stillwake.dbc; `stillwake bundle renew` makes a copy for this version"
        )
    return dbc_sha256()


def check_graph(path: Path, name: str, content: bytes) -> str:
    """Check the graph in a bundle's file and return the finding. Raises BundleControllerError for a graph that is too
    large, refers to other files, or has operators that ONNX lacks."""
    wrong = [wording for text, wording in FORBIDDEN.items() if text in content]
    if len(content) > MAX_GRAPH_BYTES:
        wrong = [f"it has {len(content)} bytes: must have at most {MAX_GRAPH_BYTES}"]
    if wrong:
        raise errors.BundleControllerError(f"bundle {path}: {name}: {wrong[0]}")
    return f"{len(content)} bytes, with all constants and only ONNX's operators"


def _verify_estimator(path: Path, contents: Mapping[str, bytes], *, is_stated: bool) -> str:
    content = contents.get(ESTIMATOR)
    if not is_stated:
        raise errors.BundleFileError(f"bundle {path}: {ESTIMATOR}: {MANIFEST} does not mention it (sensor_estimator)")
    if content is None:
        raise errors.BundleFileError(f"bundle {path}: {ESTIMATOR} is missing: {MANIFEST} has a sensor_estimator")
    return check_graph(path, ESTIMATOR, content)
