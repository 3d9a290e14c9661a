"""The number of sensors a choice may have."""

from contract import sensors
from contract.errors import ConfigError


def check_count(count: int) -> None:
    """Raises ConfigError if there are not that many sensors."""
    if not 1 <= count <= sensors.COUNT:
        raise ConfigError(f"train.sensors = {count}: must be from 1 to {sensors.COUNT}")
