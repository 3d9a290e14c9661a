"""The errors a user can cause, all under one root so that the command line can turn them into one line."""


class StillwakeError(Exception):
    """Something the user can put right; the message names the offending value and what would be right."""


class ConfigError(StillwakeError):
    """A configuration value outside its range, or a key that does not exist."""


class DatasetError(StillwakeError):
    """A dataset that does not follow the schema."""


class BundleError(StillwakeError):
    """A release bundle that is incomplete, of another schema, or altered."""


class BusError(StillwakeError):
    """The CAN bus cannot be opened, did not take a frame, or failed."""


class PlantError(StillwakeError):
    """The flow solver was given a state, mesh or action it cannot continue from, or it diverged."""


class ExportError(StillwakeError):
    """A model that cannot be lowered to a controller program."""


class McuError(StillwakeError):
    """A controller library that does not compile for, or does not run on, the emulated microcontroller."""
