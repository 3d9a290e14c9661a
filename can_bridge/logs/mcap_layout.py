"""A layout of panels for Foxglove that shows an MCAP file of ours: the wake, curves, states and events."""

from collections.abc import Mapping, Sequence
from typing import Any, Final

from can_bridge.logs.channels import ChannelGroup

WAKE_TOPIC: Final = "/wake"
EVENTS_TOPIC: Final = "/events"
_PLOTS: Final = {"pressures": ("Pa",), "command": ("m2/s",), "drag": ("Cd", "Cl")}
"""Units or names of the channels of each plot."""


def layout(groups: Sequence[ChannelGroup]) -> Mapping[str, Any]:
    """Return the layout as Foxglove reads it: a panel for the wake and one for events, plots, and a bar of states."""
    paths = [(one, f"/{group.name}.{one.identifier}") for group in groups for one in group.channels]
    panels: dict[str, Any] = {"Image!wake": {"imageMode": {"imageTopic": WAKE_TOPIC}}}
    for title, keys in _PLOTS.items():
        drawn = [_path(path) for one, path in paths if one.unit in keys or one.name in keys]
        panels[f"Plot!{title}"] = {"paths": drawn, "xAxisVal": "timestamp"}
    panels["StateTransitions!states"] = {"isSynced": True, "paths": [_path(path) for one, path in paths if one.words]}
    panels["Log!events"] = {"topicToRender": EVENTS_TOPIC, "minLogLevel": 1, "searchTerms": []}
    names = list(panels)
    return {
        "configById": panels,
        "globalVariables": {},
        "userNodes": {},
        "playbackConfig": {"speed": 1},
        "layout": {
            "direction": "row",
            "first": _column([names[0], *names[-2:]]),
            "second": _column(names[1:-2]),
        },
    }


def _path(value: str) -> Mapping[str, Any]:
    return {"value": value, "enabled": True, "timestampMethod": "receiveTime"}


def _column(names: Sequence[str]) -> Any:
    """Return panels one above the other."""
    if len(names) == 1:
        return names[0]
    share = 100.0 / len(names)
    return {"direction": "column", "first": names[0], "second": _column(names[1:]), "splitPercentage": share}
