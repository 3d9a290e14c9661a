"""The errors that a user can cause. Their common base class lets the command line print each error as one line."""

from typing import ClassVar


def install(extra: str) -> str:
    """Return the pip command that installs an extra, and the data that it needs, from a checkout; no index has them."""
    data = " ./data" if extra in ("sim", "c", "train") else ""
    return f"pip install '.[{extra}]'{data} in a checkout of stillwake"


class StillwakeError(Exception):
    """An error that the user can correct. The message states the offending value and the values that are allowed."""

    status: ClassVar[int] = 1
    """Exit status of a command that ends with this error."""


class ConfigError(StillwakeError):
    """A configuration value outside its range, or a key that does not exist."""


class ConflictError(ConfigError):
    """A combination of options or settings that exclude each other."""

    status: ClassVar[int] = 2


class OutputError(StillwakeError):
    """A result that would replace an existing file or folder, although the user did not ask to replace it."""


class DatasetError(StillwakeError):
    """A dataset that does not follow the schema."""


class TrainingError(StillwakeError):
    """A training that does not converge with its settings."""


class ModelError(StillwakeError):
    """A model directory that is incomplete, altered, or of another schema."""


class BundleError(StillwakeError):
    """A release bundle that cannot be used. Each subclass is one kind of fault."""


class BundleContainerError(BundleError):
    """A bundle's folder or image that is unreadable, truncated or too large, or has paths, links or duplicate names."""


class BundleManifestError(BundleError):
    """A manifest that is missing, damaged, altered, of another schema, or contradictory."""


class BundleFileError(BundleError):
    """A file that is missing, altered, or not in the manifest."""


class BundleDbcError(BundleFileError):
    """A bundle that was built for a DBC other than the DBC of this version."""


class BundleControllerError(BundleError):
    """A `controller.onnx` or `sensors.onnx` with forbidden content or wrong inputs or outputs, or that fails."""


class BundleSignatureError(BundleError):
    """A signature that is malformed, or was made for another manifest or image."""


class BundleSignerError(BundleError):
    """A bundle that is unsigned, or signed by a key that is not trusted."""


class KeyFileError(StillwakeError):
    """A key file that is missing, has the wrong kind of key, or already exists where a new key would be written."""


class BusError(StillwakeError):
    """A CAN bus that cannot be opened, did not accept a frame, or failed."""


class FlashError(StillwakeError):
    """A failure to flash an ECU. The subclasses in `can_bridge.tester.messages` are the kinds of failure."""


class PlantError(StillwakeError):
    """A flow solver that diverged, or that cannot continue from the given state, mesh or action."""


class ExportError(StillwakeError):
    """A model that cannot be translated to a controller program, ONNX or C."""


class LibraryError(StillwakeError):
    """A controller library that cannot be compiled or run here, or that was not built from the bundle's program."""


class McuError(StillwakeError):
    """A controller library that does not compile for the emulated microcontroller, or does not run on it."""
