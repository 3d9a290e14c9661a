"""What a viewer asks for, out of whatever came: an action and its value, or an error."""

from typing import Any, Final, NamedTuple

from contract.errors import ConfigError

_TRUE: Final = ("clear", "power_cycle", "restart")
ACTIONS: Final = ("set", "pause", *_TRUE)
"""set: values for `LiveSettings.changed`. pause: or go on. clear: everything but request, controller and plant as at
the start, and a latched fault re-armed. power_cycle: of the ECU. restart: the plant from its start."""


class Asked(NamedTuple):
    """One of `ACTIONS`; the value is a dict for set, a bool else."""

    action: str
    value: Any


def asked(request: object) -> Asked:
    """What is to be done. Raises ConfigError if it is not exactly one action with a value of its kind."""
    if not isinstance(request, dict):
        raise ConfigError("request: must be a JSON object")
    actions = [name for name in request if name != "id"]
    if len(actions) != 1 or actions[0] not in ACTIONS:
        raise ConfigError(f"request: must have one of {', '.join(ACTIONS)}, and an id")
    action, value = actions[0], request[actions[0]]
    if action == "set" and not isinstance(value, dict):
        raise ConfigError("request: set must be an object of settings")
    if action == "pause" and not isinstance(value, bool):
        raise ConfigError("request: pause must be true or false")
    if action in _TRUE and value is not True:
        raise ConfigError(f"request: {action} must be true")
    return Asked(action, value)
