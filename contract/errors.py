"""The errors a user can cause, all under one root so that the command line can turn them into one line."""

from typing import ClassVar


def install(extra: str) -> str:
    """What installs an extra, and the data that its commands begin from, for messages: no package index has us."""
    data = " ./data" if extra in ("sim", "c", "train") else ""
    return f"pip install '.[{extra}]'{data} in a checkout of stillwake"


class StillwakeError(Exception):
    """Something the user can put right; the message names the offending value and what would be right. `status` is what
    a command that ends with it exits with."""

    status: ClassVar[int] = 1


class ConfigError(StillwakeError):
    """A configuration value outside its range, or a key that does not exist."""


class ConflictError(ConfigError):
    """Options or settings that exclude each other."""

    status: ClassVar[int] = 2


class OutputError(StillwakeError):
    """Something is in the place of a result, and the user did not ask to replace it."""


class DatasetError(StillwakeError):
    """A dataset that does not follow the schema."""


class TrainingError(StillwakeError):
    """A training that does not converge with its settings."""


class ModelError(StillwakeError):
    """A model directory that is incomplete, of another schema, or altered."""


class BundleError(StillwakeError):
    """A release bundle that cannot be used; its subclasses are the kinds of fault."""


class BundleContainerError(BundleError):
    """A directory that is not read, or an image: truncated, too large, or holding paths, links or doubled names."""


class BundleManifestError(BundleError):
    """A manifest that is missing, damaged, altered, of another schema, or makes no sense."""


class BundleFileError(BundleError):
    """A file that is missing, altered, or not in the manifest; or its subclass."""


class BundleDbcError(BundleFileError):
    """A bundle for a DBC that is not this version's."""


class BundleControllerError(BundleError):
    """A `controller.onnx` that is not run: no graph of a control step, other inputs or outputs, or too slow."""


class BundleSignatureError(BundleError):
    """A signature that is malformed, or not of this manifest."""


class BundleSignerError(BundleError):
    """A bundle that the trusted key did not sign: it is unsigned, or another key's."""


class KeyFileError(StillwakeError):
    """A key file that is missing, in the way of a new one, or not a key of its kind."""


class BusError(StillwakeError):
    """The CAN bus cannot be opened, did not take a frame, or failed."""


class FlashError(StillwakeError):
    """An ECU that was not flashed; the subclasses in `can_bridge.tester.messages` are the ways in which it can end."""


class PlantError(StillwakeError):
    """The flow solver was given a state, mesh or action it cannot continue from, or it diverged."""


class ExportError(StillwakeError):
    """A model that cannot be lowered to a controller program."""


class LibraryError(StillwakeError):
    """A controller library that cannot be compiled or run on this machine, or is not of the bundle's program."""


class McuError(StillwakeError):
    """A controller library that does not compile for, or does not run on, the emulated microcontroller."""
