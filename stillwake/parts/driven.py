"""The settings for a drive at varying speeds."""

from dataclasses import replace
from typing import TYPE_CHECKING

from contract.config.tree import Config

if TYPE_CHECKING:
    from wake.plant.drive import Drive


def driven_at(name: str | None, config: Config, *, after_s: float = 0.0) -> "tuple[Drive | None, Config]":
    """Return a drive by its name or file, delayed by `after_s` seconds, and the settings with the solver steps that the
    drive needs. Without a name, return None and the unchanged settings. Raises ConfigError for an unknown drive."""
    if name is None:
        return None, config
    from wake.plant.drive import find_drive

    drive = find_drive(name, config.operating_point)
    drive = drive.after(after_s) if after_s else drive
    return drive, replace(config, flow=drive.substeps(config.flow, config.operating_point))
