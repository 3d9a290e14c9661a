"""The number of sensors a choice may have."""

from contract.errors import ConfigError


def check_count(count: int, available: int) -> None:
    """Raises ConfigError if there are not that many sensors among those that are available."""
    if not 1 <= count <= available:
        raise ConfigError(f"train.sensors = {count}: must be from 1 to {available}, the sensors that there are")
